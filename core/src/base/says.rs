//! What errors say, for people and for the log of a board.
//!
//! In: for each error its sentence. Out: `Display`, and with the feature `defmt` the same sentence
//! for defmt, which keeps it on the computer that reads the log: a board without `Display` pays no
//! flash for it. Memory: none. Cost: the text.

/// Implements `Display`, and defmt's `Format`, with one sentence for each variant of an error.
macro_rules! says {
    ($error:ty { $($variant:pat => ($text:literal $(, $value:expr)*)),+ $(,)? }) => {
        impl core::fmt::Display for $error {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                match *self {
                    $($variant => write!(f, $text $(, $value)*),)+
                }
            }
        }

        #[cfg(feature = "defmt")]
        impl defmt::Format for $error {
            fn format(&self, f: defmt::Formatter<'_>) {
                match *self {
                    $($variant => defmt::write!(f, $text $(, $value)*),)+
                }
            }
        }

        impl core::error::Error for $error {}
    };
}
pub(crate) use says;
