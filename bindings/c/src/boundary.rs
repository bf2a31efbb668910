//! Checks what comes from C before Rust believes it.
//!
//! In: pointers and lengths. Out: references and slices, or the status that says what is wrong with
//! them. A pointer that is not null, aligned, and does not lead around the end of the address space
//! can still be wrong; no library can check that. Memory: none. Cost: some comparisons.

use crate::status::kg_status;

/// What the body of a function of the interface returns.
pub(crate) type Outcome<T = kg_status> = Result<T, kg_status>;

/// Makes one status of an outcome.
pub(crate) fn told(outcome: Outcome) -> kg_status {
    match outcome {
        Ok(status) | Err(status) => status,
    }
}

/// Refuses a null pointer, a misaligned one, and `count` elements that no memory can hold.
pub(crate) fn check<T>(p: *const T, count: usize) -> Outcome<()> {
    if p.is_null() {
        return Err(kg_status::KG_ERROR_NULL);
    }
    if !p.is_aligned() {
        return Err(kg_status::KG_ERROR_ALIGNMENT);
    }
    let bytes = count.checked_mul(size_of::<T>()).filter(|&bytes| isize::try_from(bytes).is_ok());
    let end = bytes.and_then(|bytes| p.addr().checked_add(bytes));
    end.map(|_| ()).ok_or(kg_status::KG_ERROR_LENGTH)
}

/// Borrows what a pointer leads to.
///
/// # Safety
/// If the pointer passes the checks, it leads to a `T` that stays as it is while it is borrowed.
pub(crate) unsafe fn shared<'a, T>(p: *const T) -> Outcome<&'a T> {
    check(p, 1)?;
    // SAFETY: the pointer is aligned and not null, and the caller vouches for the rest.
    Ok(unsafe { &*p })
}

/// Borrows what a pointer leads to, or nothing when it is null.
///
/// # Safety
/// As for [`shared`].
pub(crate) unsafe fn optional<'a, T>(p: *const T) -> Outcome<Option<&'a T>> {
    if p.is_null() {
        return Ok(None);
    }
    // SAFETY: the contract is the same.
    unsafe { shared(p) }.map(Some)
}

/// Borrows `count` bytes.
///
/// # Safety
/// If the pointer passes the checks, it leads to `count` bytes that nobody writes while they are
/// borrowed.
pub(crate) unsafe fn bytes<'a>(p: *const u8, count: usize) -> Outcome<&'a [u8]> {
    check(p, count)?;
    // SAFETY: the pointer is not null, the length fits, and the caller vouches for the rest.
    Ok(unsafe { core::slice::from_raw_parts(p, count) })
}

/// Borrows `count` bytes to write.
///
/// # Safety
/// If the pointer passes the checks, it leads to `count` bytes that nobody else uses while they are
/// borrowed.
pub(crate) unsafe fn bytes_mut<'a>(p: *mut u8, count: usize) -> Outcome<&'a mut [u8]> {
    check(p, count)?;
    // SAFETY: the pointer is not null, the length fits, and the caller vouches for the rest.
    Ok(unsafe { core::slice::from_raw_parts_mut(p, count) })
}

/// Writes a result. What was there before is not read.
///
/// # Safety
/// If the pointer passes the checks, a `T` can be written there.
pub(crate) unsafe fn put<T: Copy>(p: *mut T, value: T) -> Outcome<()> {
    check(p, 1)?;
    // SAFETY: the pointer is aligned and not null, and the caller vouches for the rest.
    unsafe { p.write(value) };
    Ok(())
}

/// Writes the first results of `all` into an array of `room`, and how many there are into `count`.
/// An array without room may be null. Nothing is written when a pointer is refused.
///
/// # Safety
/// If the pointers pass the checks, `room` elements can be written to `out`, and a number to `count`.
pub(crate) unsafe fn list<T: Copy>(
    all: impl Iterator<Item = T>,
    out: *mut T,
    room: usize,
    count: *mut usize,
) -> Outcome<()> {
    if room > 0 {
        check(out, room)?;
    }
    check(count, 1)?;
    let mut n = 0;
    for value in all {
        if n < room {
            // SAFETY: the array has `room` elements, and `n` is less.
            let place = unsafe { out.add(n) };
            // SAFETY: the place is within the array.
            unsafe { place.write(value) };
        }
        n += 1;
    }
    // SAFETY: it was checked above, and the caller vouches for the rest.
    unsafe { put(count, n) }
}

/// Borrows the text before the first zero byte.
///
/// # Safety
/// If the pointer is not null, it leads to a text that ends with a zero byte, or to `most` bytes.
pub(crate) unsafe fn text<'a>(p: *const u8, most: usize) -> Outcome<&'a str> {
    check(p, 1)?;
    // SAFETY: the bytes up to the first zero byte are the caller's, and reading stops there.
    let at = |n: usize| unsafe { p.add(n).read() };
    let n = (0..most).find(|&n| at(n) == 0).ok_or(kg_status::KG_ERROR_NAME)?;
    // SAFETY: that many bytes were just read.
    let bytes = unsafe { bytes(p, n) }?;
    core::str::from_utf8(bytes).map_err(|_| kg_status::KG_ERROR_NAME)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointers_are_refused_before_they_are_used() {
        let word = 7u32;
        let p = &raw const word;
        assert_eq!(check(p, 1), Ok(()));
        assert_eq!(check(core::ptr::null::<u32>(), 1), Err(kg_status::KG_ERROR_NULL));
        assert_eq!(check(p.wrapping_byte_add(1), 1), Err(kg_status::KG_ERROR_ALIGNMENT));
        assert_eq!(check(p, usize::MAX / 2), Err(kg_status::KG_ERROR_LENGTH), "the product has no number");
        assert_eq!(check(p, isize::MAX.unsigned_abs() / 4 + 1), Err(kg_status::KG_ERROR_LENGTH));
        let last = core::ptr::without_provenance::<u8>(usize::MAX - 3);
        assert_eq!(check(last, 3), Ok(()));
        assert_eq!(check(last, 4), Err(kg_status::KG_ERROR_LENGTH), "around the end of the address space");
    }

    #[test]
    fn a_list_is_cut_and_counted() {
        let mut out = [0u32; 3];
        let mut count = 0;
        let mut run = |room, out: *mut u32| {
            // SAFETY: the array has three elements, and nobody else uses it.
            let done = unsafe { list([5, 6, 7, 8].into_iter(), out, room, &raw mut count) };
            (done, count)
        };
        assert_eq!(run(2, out.as_mut_ptr()), (Ok(()), 4));
        assert_eq!(run(0, core::ptr::null_mut()), (Ok(()), 4));
        assert_eq!(run(1, core::ptr::null_mut()).0, Err(kg_status::KG_ERROR_NULL));
        assert_eq!(out, [5, 6, 0]);
    }

    #[test]
    fn a_text_ends_in_time_and_is_utf8() {
        // SAFETY: every text has that many bytes.
        let read = |bytes: &'static [u8]| unsafe { text(bytes.as_ptr(), bytes.len()) };
        assert_eq!(read(b"box\0rest"), Ok("box"));
        assert_eq!(read(b"box"), Err(kg_status::KG_ERROR_NAME), "it does not end");
        assert_eq!(read(b"\xff\0"), Err(kg_status::KG_ERROR_NAME));
    }
}
