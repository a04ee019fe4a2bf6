//! Integers with which the driver and the controller's KRL program agree on command mode and strategy.
//! Plain tables; used by the host's thread.

use rcc_core::impedance::ControlMode;

use crate::fri_lwr::wire::KrlBlock;

/// Convention between the PC and the KRL program for entering command mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KrlConvention {
    /// KUKA's samples: `$FRI_FRM_INT[1]` is 1, then 10 to request command mode; 0 leaves it.
    FirstApp,
    /// The Stanford library: `$FRI_FRM_INT[16]` is 10 to request command mode, 20 to leave it.
    Stanford,
    /// Centro E. Piaggio: `$FRI_FRM_INT[2]` is 1 to request command mode, 0 to leave it.
    Centro,
    /// The KRL program alone decides.
    Auto,
}

/// Request of the driver to the KRL program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeRequest {
    /// Not yet: the connection quality is too low.
    Present,
    /// Command mode.
    Start,
    /// Monitor mode.
    Stop,
}

/// The integers of a convention; variables are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handshake {
    /// Number of `$FRI_FRM_INT` that holds the request; its values are `present`, `start` and `stop`.
    pub request: usize,
    present: i32,
    start: i32,
    stop: i32,
    /// Number of `$FRI_FRM_INT` that chooses the strategy.
    pub strategy: usize,
    /// The program expects a strategy with every request.
    pub needs_strategy: bool,
}

impl KrlConvention {
    /// Returns the integers of a convention; `None` if the program takes no requests.
    #[must_use]
    pub fn handshake(self) -> Option<Handshake> {
        Some(match self {
            KrlConvention::FirstApp => Handshake {
                request: 1,
                present: 1,
                start: 10,
                stop: 0,
                strategy: 2,
                needs_strategy: false,
            },
            KrlConvention::Stanford => Handshake {
                request: 16,
                present: 0,
                start: 10,
                stop: 20,
                strategy: 15,
                needs_strategy: true,
            },
            KrlConvention::Centro => Handshake {
                request: 2,
                present: 0,
                start: 1,
                stop: 0,
                strategy: 1,
                needs_strategy: true,
            },
            KrlConvention::Auto => return None,
        })
    }
}

impl Handshake {
    /// Writes the request and, if given, the strategy.
    pub fn write(&self, krl: &mut KrlBlock, request: ModeRequest, strategy: Option<ControlMode>) {
        let value = match request {
            ModeRequest::Present => self.present,
            ModeRequest::Start => self.start,
            ModeRequest::Stop => self.stop,
        };
        let chosen = strategy.map(krl_strategy);
        for (number, value) in [(self.request, Some(value)), (self.strategy, chosen)] {
            if let (Some(place), Some(value)) = (krl.integers.get_mut(number - 1), value) {
                *place = value;
            }
        }
    }
}

/// Returns the value of `$STIFFNESS.STRATEGY`.
fn krl_strategy(strategy: ControlMode) -> i32 {
    match strategy {
        ControlMode::Position => 10,
        ControlMode::CartesianImpedance => 20,
        ControlMode::JointImpedance => 30,
    }
}
