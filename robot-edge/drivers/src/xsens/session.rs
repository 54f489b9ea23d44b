//! How a connection with an `MTi` goes: it is configured each time, for it may be another one.

use std::time::Duration;

use measurement::MeasurementData;

use super::{
    Data, Item, Message, OutputSetting, XsensDecoder, data_id, error_meaning, go_to_config,
    go_to_measurement, request_device_id, set_output_configuration,
};
use crate::clock_mapping::DeviceTime;
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};

/// With every message.
const ALWAYS: u16 = 0xFFFF;
const RATE_HZ: f64 = 100.0;

/// An attitude sensor.
#[derive(Debug)]
pub struct Xsens {
    settings: Vec<OutputSetting>,
    packet_counter: Option<u16>,
}

impl Xsens {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let rate_hz = config.rate_hz.unwrap_or(RATE_HZ).round() as u16;
        let settings = [
            (data_id::PACKET_COUNTER, ALWAYS),
            (data_id::SAMPLE_TIME_FINE, ALWAYS),
            (data_id::QUATERNION, rate_hz),
            (data_id::ACCELERATION, rate_hz),
            (data_id::RATE_OF_TURN, rate_hz),
            (data_id::STATUS_WORD, ALWAYS),
        ];
        let setting = |(data_id, rate_hz)| OutputSetting { data_id, rate_hz };
        Self {
            settings: settings.map(setting).to_vec(),
            packet_counter: None,
        }
    }

    fn data(&mut self, data: &Data) -> Event {
        let counter = data.items.iter().find_map(|item| match item {
            Item::PacketCounter(counter) => Some(*counter),
            _ => None,
        });
        if counter.is_some() && self.packet_counter == counter {
            return Event::Repeated;
        }
        self.packet_counter = counter;
        // A counter of 0.1 ms.
        let sent = data.items.iter().find_map(|item| match item {
            Item::SampleTimeFine(ticks) => Some(DeviceTime::counter(*ticks, 100_000, 32)),
            _ => None,
        });
        data.imu().map_or(Event::Unexpected, |imu| {
            Event::Sample(Sample {
                sent,
                age: Duration::ZERO,
                data: MeasurementData::Imu(imu),
            })
        })
    }
}

impl Device for Xsens {
    type Decoder = XsensDecoder;

    fn connect(&mut self) -> XsensDecoder {
        self.packet_counter = None;
        XsensDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            0 => Step::ask("GoToConfig", go_to_config()),
            1 => Step::ask("ReqDID", request_device_id()),
            2 => Step::ask(
                "SetOutputConfiguration",
                set_output_configuration(&self.settings).unwrap_or_default(),
            ),
            3 => Step::ask("GoToMeasurement", go_to_measurement()),
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        let event = match (message, awaited) {
            (Message::Data(data), _) => self.data(&data),
            (Message::Configuring, Some(0)) | (Message::Measuring, Some(3)) => Event::Accepted,
            (Message::DeviceId(id), Some(1)) => {
                events.push(Event::Identity(format!("MTi {id:08X}")));
                Event::Accepted
            }
            (Message::OutputConfiguration(settings), Some(2)) => {
                let is_same = |(is, wanted): (&OutputSetting, &OutputSetting)| {
                    is.data_id == wanted.data_id
                        && (is.rate_hz == wanted.rate_hz || wanted.rate_hz == ALWAYS)
                };
                let all = settings.len() == self.settings.len();
                if all && settings.iter().zip(&self.settings).all(is_same) {
                    Event::Accepted
                } else {
                    Event::Refused(format!(
                        "the device does not take the outputs or their rate; it has {settings:04X?}"
                    ))
                }
            }
            // It has power again. While it is awaited, the reply to GoToConfig comes later.
            (Message::WakeUp, awaited) if awaited != Some(0) => Event::Restarted,
            (Message::Error(code), _) => Event::Refused(error_meaning(code).to_owned()),
            _ => Event::Unexpected,
        };
        events.push(event);
    }
}
