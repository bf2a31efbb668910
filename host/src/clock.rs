//! The time of day as lines have it: RFC 3339 in UTC, to the millisecond.
//!
//! In: a time of the system's clock. Out: `2026-11-29T20:31:05.123Z`. Memory and cost: the text.

use std::time::SystemTime;

/// A time in UTC as in RFC 3339, to the millisecond.
#[must_use]
pub fn stamp(time: SystemTime) -> String {
    // A clock that was never set may lie before the epoch, which has no stamp.
    humantime::format_rfc3339_millis(time.max(SystemTime::UNIX_EPOCH)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn stamps_have_milliseconds_and_are_never_before_the_epoch() {
        let epoch = SystemTime::UNIX_EPOCH;
        assert_eq!(stamp(epoch + Duration::from_millis(1_764_326_096_007)), "2025-11-28T10:34:56.007Z");
        assert_eq!(stamp(epoch - Duration::from_secs(1)), "1970-01-01T00:00:00.000Z");
    }
}
