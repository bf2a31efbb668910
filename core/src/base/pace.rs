//! Asks whether work goes on.
//!
//! In: a question every hundred thousand instructions or so. Out: whether to go on. A stage that is
//! told to stop returns at once, with what it has. Only the conversion of a frame and its pyramid go on
//! to their end. Memory and cost: a call.

/// Answers whether work goes on.
pub trait Pace {
    /// Whether work goes on. After it has answered no, it always does.
    fn goes_on(&mut self) -> bool;
}

/// Goes on to the end.
#[derive(Clone, Copy, Debug)]
pub struct Steady;

impl Pace for Steady {
    fn goes_on(&mut self) -> bool {
        true
    }
}
