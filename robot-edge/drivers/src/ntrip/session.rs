//! How a connection with an NTRIP caster goes. Its corrections are for another device.

use std::time::Duration;

use super::{Message, NtripDecoder, Version, request};
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Step};

/// A caster.
#[derive(Debug)]
pub struct Ntrip {
    request: Vec<u8>,
    identity: String,
}

impl Ntrip {
    /// As configured. `None` if a text has characters that a request cannot hold.
    pub fn new(config: &DeviceConfig) -> Option<Self> {
        let host = config.tcp.as_deref()?;
        let mountpoint = config.mountpoint.as_deref()?;
        let login = config.user.as_deref().zip(config.password.as_deref());
        Some(Self {
            request: request(Version::Two, host, mountpoint, login)?,
            identity: format!("{host}/{mountpoint}"),
        })
    }
}

impl Device for Ntrip {
    type Decoder = NtripDecoder;

    fn connect(&mut self) -> NtripDecoder {
        NtripDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            0 => Step::ask("the request for corrections", self.request.clone()),
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        match message {
            Message::Accepted if awaited == Some(0) => {
                events.push(Event::Identity(self.identity.clone()));
                events.push(Event::Accepted);
            }
            Message::Accepted => events.push(Event::Unexpected),
            Message::Rtcm(rtcm) => events.push(Event::Forward(rtcm.frame)),
            Message::Refused(line) => {
                let text = format!("the caster refuses: {line}");
                events.push(Event::Refused(text));
            }
            Message::Ended => events.push(Event::Refused("the caster ended".to_owned())),
        }
    }

    /// Some bases send each ten seconds.
    fn max_silence(&self) -> Duration {
        Duration::from_secs(30)
    }

    fn max_warm_up(&self) -> Duration {
        Duration::from_secs(30)
    }
}
