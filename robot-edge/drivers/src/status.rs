//! What is known of a device now, for a panel.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use measurement::time::Monotonic;
use tokio::sync::watch;

use crate::DropReason;
use crate::clock_mapping::ClockStatus;

/// A device now.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceStatus {
    /// What the supervisor does with it.
    pub state: State,
    /// Why the last connection ended, or was not made; none once the device measures.
    pub trouble: Option<Trouble>,
    /// Which device it says it is.
    pub identity: Option<String>,
    /// Measurements passed on per second, over the last second or more.
    pub rate_hz: f64,
    /// When the newest measurement arrived.
    pub measured_at: Option<Monotonic>,
    /// Measurements that were passed on.
    pub measurements: u64,
    /// Connections that ended after the device had measured.
    pub lost_connections: u64,
    /// How often another device answered than before.
    pub identity_changes: u64,
    /// What was received and not passed on.
    pub losses: BTreeMap<Loss, u64>,
    /// Its clock, if it has one.
    pub clock: Option<ClockStatus>,
}

/// All devices, for any thread.
#[derive(Clone, Debug)]
pub struct DeviceStatuses(pub(crate) Vec<(String, watch::Receiver<DeviceStatus>)>);

impl DeviceStatuses {
    /// Names of the devices, and what is known of them now.
    pub fn now(&self) -> impl Iterator<Item = (&str, DeviceStatus)> {
        let statuses = self.0.iter();
        statuses.map(|(name, status)| (name.as_str(), status.borrow().clone()))
    }

    /// Losses of all devices.
    pub fn lost_total(&self) -> u64 {
        let of_device = |(_, status): &(_, watch::Receiver<DeviceStatus>)| -> u64 {
            status.borrow().losses.values().sum()
        };
        self.0.iter().map(of_device).sum()
    }
}

/// What the supervisor does with a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// It waits until the device can be connected to.
    #[default]
    Connecting,
    /// It configures the device, or waits for the first measurement.
    Configuring,
    /// The device measures.
    Measuring,
}

/// Why a connection ended or was not made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Trouble {
    /// The system refuses.
    #[error("{0}")]
    Io(String),
    /// Nobody answers at the address.
    #[error("nothing answers at this address: is the device on, and the cable plugged in?")]
    NoConnection,
    /// The device ended the connection.
    #[error("the device ended the connection")]
    Closed,
    /// No reply.
    #[error("no reply to {0}")]
    NoReply(&'static str),
    /// No measurement for some time.
    #[error("no measurement for {0:?}")]
    Silent(Duration),
    /// The device cannot do what was asked.
    #[error("{0}")]
    Refused(String),
    /// Another device than before.
    #[error("another device than before: {new} (it was {old})")]
    IdentityChanged {
        /// It was this.
        old: String,
        /// It is this.
        new: String,
    },
    /// Not the configured device.
    #[error("`identity` is \"{configured}\", but the device is {found}")]
    WrongIdentity {
        /// What the configuration says.
        configured: String,
        /// What the device says.
        found: String,
    },
}

/// Why something that was received is not passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Loss {
    /// The decoder dropped it.
    Decoder(DropReason),
    /// Older than [`MAX_AGE`](crate::clock_mapping::MAX_AGE) when it arrived; of a device that measures when it is
    /// asked, later than the promptest reply by over a quarter of the time between two requests.
    Stale,
    /// Sent before the last one, or the same again.
    Repeated,
    /// A scan whose angles or times are impossible, or without a beam in the sector.
    BadScan,
    /// The receiver of measurements is too slow.
    QueueFull,
    /// A message without a use, or the reply to another request.
    Unexpected,
}

impl fmt::Display for Loss {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Decoder(reason) => return reason.fmt(formatter),
            Self::Stale => "stale",
            Self::Repeated => "repeated",
            Self::BadScan => "bad_scan",
            Self::QueueFull => "queue_full",
            Self::Unexpected => "unexpected",
        })
    }
}

impl DeviceStatus {
    /// Counts losses.
    pub(crate) fn lose(&mut self, loss: Loss, count: u64) {
        if count > 0 {
            let counted = self.losses.entry(loss).or_default();
            *counted = counted.saturating_add(count);
        }
    }

    /// Losses for this reason.
    pub fn lost(&self, loss: Loss) -> u64 {
        self.losses.get(&loss).copied().unwrap_or_default()
    }
}
