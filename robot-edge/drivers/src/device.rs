//! What the supervisor needs of a device: what to ask of it, and what its messages mean.
//!
//! A device's module implements [`Device`] beside its codec. It has no clock and no socket: the
//! supervisor sends, waits and measures time.

use std::net::IpAddr;
use std::time::Duration;

use measurement::MeasurementData;

use crate::clock_mapping::DeviceTime;
use crate::{Address, Decoder};

/// How a connection with a device goes.
pub trait Device: Send + 'static {
    /// Its codec.
    type Decoder: Decoder<Message: Send> + Send;

    /// A connection begins: a decoder for it. What was known of the last connection is forgotten.
    fn connect(&mut self) -> Self::Decoder;

    /// What is asked of it at another address before each connection.
    fn preparation(&mut self) -> Option<&mut dyn Preparation> {
        None
    }

    /// A step of the configuration; steps count from 0 and end with [`Step::Done`]. A step is repeated
    /// if its reply does not come.
    fn step(&self, step: usize) -> Step;

    /// What a message means. `awaited` is the step whose reply is awaited, if one is.
    fn take(&mut self, message: MessageOf<Self>, awaited: Option<usize>, events: &mut Vec<Event>);

    /// Which of several outputs gave the data; their streams follow each other.
    fn output(&self, _data: &MeasurementData) -> u16 {
        0
    }

    /// For a device that measures when it is asked: the time between two requests.
    fn poll_period(&self) -> Option<Duration> {
        None
    }

    /// The request for one measurement.
    fn poll(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// It measures in the moment in which it is asked, and replies at once.
    fn measures_when_asked(&self) -> bool {
        false
    }

    /// A device that measures nothing for longer is lost.
    fn max_silence(&self) -> Duration {
        Duration::from_secs(1)
    }

    /// The same, after the configuration: a motor takes time to turn.
    fn max_warm_up(&self) -> Duration {
        Duration::from_secs(5)
    }
}

/// A request at another address than that of the measurements.
pub trait Preparation: Send {
    /// What is asked, for people.
    fn name(&self) -> &'static str;

    /// Where.
    fn address(&self) -> Address;

    /// The request. `own`: this computer's address on the way to the device.
    fn request(&self, own: IpAddr) -> Vec<u8>;

    /// Takes the reply: a datagram, or all until the end of the connection. Fails with why the device cannot be used.
    fn take(&mut self, reply: &[u8]) -> Result<(), String>;
}

/// What a device's decoder gives.
pub type MessageOf<D> = <<D as Device>::Decoder as Decoder>::Message;

/// A step of the configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Send this; the step ends with [`Event::Accepted`].
    Ask(Request),
    /// Send this; there is no reply.
    Tell(Vec<u8>),
    /// Nothing to do.
    Skip,
    /// The device is configured, and measures.
    Done,
}

/// A request with a reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its name in the protocol.
    pub name: &'static str,
    /// What is sent.
    pub bytes: Vec<u8>,
}

impl Step {
    /// A request with a reply.
    pub fn ask(name: &'static str, bytes: impl Into<Vec<u8>>) -> Self {
        Self::Ask(Request {
            name,
            bytes: bytes.into(),
        })
    }
}

/// What a message means.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The reply that was awaited.
    Accepted,
    /// The device is busy: ask again soon.
    NotYet,
    /// The device refuses, is faulty or set otherwise than asked: connect again.
    Refused(String),
    /// The device has started again by itself: configure it again.
    Restarted,
    /// Which device it is, at least once in each connection that measures if the device says it.
    Identity(String),
    /// Measured data.
    Sample(Sample),
    /// Bytes for the device that this one works for, or the other way round.
    Forward(Vec<u8>),
    /// A request while it measures was obeyed.
    Done,
    /// The same scan again.
    Repeated,
    /// A message without a use, the reply to another request for one.
    Unexpected,
}

/// Measured data.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// When the device sent it, or began to, by its own clock if it has one.
    pub sent: Option<DeviceTime>,
    /// Time from the data's stamp to [`Self::sent`], or to the arrival without it.
    pub age: Duration,
    /// The data.
    pub data: MeasurementData,
}
