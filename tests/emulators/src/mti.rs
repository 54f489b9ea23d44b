//! Xsens `MTi`, Xbus with `MTData2`.
//!
//! Written from the MT Low Level Communication Protocol (MT0101P) as the packets of
//! Scottapotamas/xsens-mti (`docs/mtmanager_packets.md` at 9c039b0) show it: preamble FA, bus FF,
//! message, length, data, and a sum that makes all after the preamble 0. The configuration is kept
//! without power.

use std::time::Duration;

use crate::feed::Feed;
use crate::{Device, Ticks, take_request};

/// An attitude sensor.
#[derive(Debug)]
pub struct Mti {
    /// Its identifier.
    pub device_id: u32,
    /// It sends garbage between messages.
    pub has_garbage: bool,
    /// It ignores requests.
    pub is_mute: bool,
    /// Identifiers and rates.
    settings: Vec<(u16, u16)>,
    state: State,
    counter: u16,
    buffer: Vec<u8>,
    ticks: Ticks,
    feed: Feed<Sample>,
}

/// What it measures.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Quaternion (w, x, y, z) that turns vectors from the sensor's frame to east, north, up.
    pub attitude_wxyz: [f32; 4],
    /// Specific force, m/s².
    pub force_mps2: [f32; 3],
    /// Turn rates, rad/s.
    pub rates_radps: [f32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// It measures from then on, if no host says otherwise.
    Starting,
    Configuring,
    Measuring,
}

impl Default for Mti {
    fn default() -> Self {
        Self {
            device_id: 0x0360_1234,
            has_garbage: false,
            is_mute: false,
            settings: Vec::new(),
            state: State::Starting,
            counter: 0,
            buffer: Vec::new(),
            ticks: Ticks::default(),
            feed: Feed::default(),
        }
    }
}

const START: Duration = Duration::from_millis(500);

/// Yaw that it reports after this many samples, radians.
pub fn yaw_rad(sample: u16) -> f32 {
    0.01 * f32::from(sample % 300)
}

fn message(identifier: u8, data: &[u8]) -> Vec<u8> {
    let mut message = vec![0xFA, 0xFF, identifier, data.len() as u8];
    message.extend_from_slice(data);
    let sum = message[1..]
        .iter()
        .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    message.push(0_u8.wrapping_sub(sum));
    message
}

impl Mti {
    /// Gives it a sample of `at`.
    pub fn feed(&mut self, at: Duration, sample: Sample) {
        self.feed.push(at, sample);
    }

    /// It is configured and sends samples.
    pub fn is_measuring(&self) -> bool {
        self.state == State::Measuring && !self.settings.is_empty()
    }

    /// What it makes up.
    fn made_up(&self) -> Sample {
        let half = yaw_rad(self.counter) / 2.0;
        Sample {
            attitude_wxyz: [half.cos(), 0.0, 0.0, half.sin()],
            force_mps2: [0.1, -0.2, 9.81],
            rates_radps: [0.01, 0.02, -0.03],
        }
    }

    fn reply(&mut self, request: &[u8], uptime: Duration) -> Vec<u8> {
        let data = &request[4..request.len() - 1];
        match (request[2], self.state) {
            (0x30, _) => {
                self.state = State::Configuring;
                message(0x31, &[])
            }
            (0x10, _) => {
                self.state = State::Measuring;
                message(0x11, &[])
            }
            (0x00, State::Configuring) => message(0x01, &self.device_id.to_be_bytes()),
            (0xC0, State::Configuring) => {
                if !data.is_empty() {
                    let word = |bytes: &[u8]| u16::from_be_bytes([bytes[0], bytes[1]]);
                    let entries = data.chunks_exact(4);
                    self.settings = entries
                        .map(|entry| (word(entry), word(&entry[2..])))
                        .collect();
                    self.ticks.change_period(uptime, self.period());
                }
                let entries = self.settings.iter();
                let words = entries.flat_map(|(id, rate)| [id.to_be_bytes(), rate.to_be_bytes()]);
                message(0xC1, &words.flatten().collect::<Vec<u8>>())
            }
            // Invalid message.
            _ => message(0x42, &[4]),
        }
    }

    fn period(&self) -> Duration {
        let rates = self.settings.iter().map(|(_, rate)| *rate);
        let rate = rates.filter(|rate| *rate < 0xFFFF).max();
        Duration::from_secs(1) / u32::from(rate.unwrap_or(100).max(1))
    }

    fn message(&self, at: Duration, sample: &Sample) -> Vec<u8> {
        let mut data = Vec::new();
        let reals = |values: &[f32]| -> Vec<u8> {
            values
                .iter()
                .flat_map(|value| value.to_be_bytes())
                .collect()
        };
        for (id, _) in &self.settings {
            let content = match id {
                0x1020 => self.counter.to_be_bytes().to_vec(),
                // Ticks of 10 kHz.
                0x1060 => ((at.as_micros() / 100) as u32).to_be_bytes().to_vec(),
                0x2010 => reals(&sample.attitude_wxyz),
                0x4020 => reals(&sample.force_mps2),
                0x8020 => reals(&sample.rates_radps),
                // Self-test and filter are good.
                0xE020 => vec![0, 0, 0, 3],
                _ => continue,
            };
            data.extend_from_slice(&id.to_be_bytes());
            data.push(content.len() as u8);
            data.extend_from_slice(&content);
        }
        message(0x36, &data)
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.windows(2).position(|pair| pair == [0xFA, 0xFF])?;
    let rest = &bytes[start..];
    let length = usize::from(*rest.get(3)?) + 5;
    (rest.len() >= length).then_some((start, length))
}

impl Device for Mti {
    fn power_on(&mut self) -> Vec<u8> {
        self.state = State::Starting;
        self.counter = 0;
        self.buffer.clear();
        self.ticks.restart();
        // WakeUp.
        message(0x3E, &[])
    }

    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(request) = take_request(&mut self.buffer, find) {
            if !self.is_mute {
                replies.extend(self.reply(&request, uptime));
            }
        }
        replies
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        if self.state == State::Starting && uptime >= START {
            self.state = State::Measuring;
        }
        let due = self.ticks.due(uptime, self.period());
        let fed = self.feed.take_until(uptime);
        if self.state != State::Measuring {
            return Vec::new();
        }
        let mut sent = Vec::new();
        let fed: Vec<(Duration, Option<Sample>)> = match fed {
            Some(fed) => fed
                .into_iter()
                .map(|(at, sample)| (at, Some(sample)))
                .collect(),
            None => due.map(|_| (uptime, None)).collect(),
        };
        for (at, sample) in fed {
            self.counter = self.counter.wrapping_add(1);
            let sample = sample.unwrap_or_else(|| self.made_up());
            if self.has_garbage {
                sent.push(vec![0xFA, 0xFF, 0x36, 5, 0xFA, 1, 2]);
            }
            sent.push(self.message(at, &sample));
        }
        sent
    }
}
