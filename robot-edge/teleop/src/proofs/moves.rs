//! What people, network and hardware do in a random sequence.

use crate::input::CollisionMonitorOutput;
use crate::input::LeaseVerb;
use crate::lease::StoredEStop;
use crate::motion::Velocity;

/// What happens to a command on its way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fate {
    Arrives,
    Twice,
    Lost,
    /// Waits for that many rounds, so that later ones pass it.
    Late(u8),
}

/// One move of people, network and hardware.
#[derive(Clone, Debug)]
pub(super) enum Move {
    /// Rounds of the loop in which consoles that are open send what is pressed.
    Rounds {
        count: u8,
        millis: u8,
        fate: Fate,
    },
    /// The link stands still for so many rounds of 20 ms, then delivers everything.
    Stall(u8),
    /// The loop itself is late.
    Pause(u16),
    Stick {
        who: u8,
        requested: Velocity,
    },
    /// Opens a console, or freezes it.
    Open {
        who: u8,
        is_open: bool,
    },
    Lease {
        who: u8,
        verb: LeaseVerb,
        tokens_ago: u8,
    },
    EStop {
        who: u8,
    },
    LocalEStop,
    Stored {
        is_right: bool,
    },
    Reset {
        who: u8,
        is_right: bool,
        tokens_ago: u8,
    },
    LocalReset,
    SelfTest {
        has_passed: bool,
        stored: StoredEStop,
    },
    CollisionMonitor(CollisionMonitorOutput),
    /// The guard no longer speaks, or does again.
    MonitorResponds(bool),
    Fault,
    Revoke {
        who: u8,
    },
    /// A command that no honest console sends.
    Forge {
        who: u8,
        epochs_ago: u8,
        seq_offset: i8,
        tokens_ago: u8,
        nonce_is_right: bool,
        requested: Velocity,
        estop: bool,
    },
    /// A command that was sent before, once more.
    Replay(u8),
    /// To a vehicle that is driven by operator 0.
    StartDriving,
}
