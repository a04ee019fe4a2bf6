//! The ways in which a net is stopped.

/// How a net is stopped; the later one is stronger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StopKind {
    /// CANCEL: the net brakes on its path and ends by itself.
    Cancel,
    /// ABORT: the net ends now.
    Abort,
}

impl StopKind {
    /// Returns CANCEL for a net that has a `Cancel`, and ABORT for others.
    #[must_use]
    pub fn gentlest(can_cancel: bool) -> StopKind {
        match can_cancel {
            true => StopKind::Cancel,
            false => StopKind::Abort,
        }
    }

    /// Returns the name of the loader's operation.
    #[must_use]
    pub fn operation(self) -> &'static str {
        match self {
            StopKind::Cancel => "cancel",
            StopKind::Abort => "abort",
        }
    }
}
