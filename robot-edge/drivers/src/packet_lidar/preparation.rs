//! What is asked of a lidar before its packets are read: an Ouster's metadata, and that a Livox sends to this computer.
//!
//! Sources: Ouster, "Software User Manual" 2.3, HTTP API; Livox, "Livox `LiDAR` Communication Protocol Mid-360", version 1.4.10,
//! commands, and `sdk_protocol.cpp` and `build_request.cpp` of Livox-SDK2 (MIT), which send the same. No sensor was at hand.

use std::net::IpAddr;

use lidar::ouster::Ouster;

use crate::Address;
use crate::config::DeviceConfig;
use crate::device::Preparation;

const HTTP_PORT: u16 = 80;
const METADATA: &str = "/api/v1/sensor/metadata";

/// The metadata of an Ouster, fetched before each connection: it may be set otherwise, or be another one.
#[derive(Debug)]
pub(super) struct OusterMetadata {
    host: String,
    ouster: Option<Ouster>,
}

impl OusterMetadata {
    pub(super) fn new(config: &DeviceConfig) -> Result<Self, (&'static str, String)> {
        let host = config.host(HTTP_PORT);
        Ok(Self {
            host: host.ok_or_else(|| ("host", "missing: such a device needs it".to_owned()))?,
            ouster: None,
        })
    }

    pub(super) fn ouster(&self) -> Option<Ouster> {
        self.ouster.clone()
    }
}

impl Preparation for OusterMetadata {
    fn name(&self) -> &'static str {
        "the sensor's metadata"
    }

    fn address(&self) -> Address {
        Address::Tcp(self.host.clone())
    }

    /// In HTTP 1.0, to which the reply comes in one piece and ends with the connection.
    fn request(&self, _own: IpAddr) -> Vec<u8> {
        let host = &self.host;
        format!("GET {METADATA} HTTP/1.0\r\nHost: {host}\r\nConnection: close\r\n\r\n").into_bytes()
    }

    fn take(&mut self, reply: &[u8]) -> Result<(), String> {
        self.ouster = None;
        let text = String::from_utf8_lossy(reply);
        let (header, body) = text
            .split_once("\r\n\r\n")
            .ok_or_else(|| "the reply is no HTTP".to_owned())?;
        let status = header.lines().next().unwrap_or_default();
        let mut words = status.split_ascii_whitespace();
        let is_http = words.next().is_some_and(|word| word.starts_with("HTTP/1."));
        if !is_http || words.next() != Some("200") {
            return Err(format!(
                "\"{status}\"; of firmware without {METADATA}, name a file in `metadata`"
            ));
        }
        self.ouster = Some(Ouster::new(body).map_err(|error| error.to_string())?);
        Ok(())
    }
}

const COMMAND_PORT: u16 = 56_100;
/// From which a Mid-360 sends points.
const POINT_PORT: u16 = 56_300;
const HEADER: usize = 24;
const MARK: u8 = 0xAA;
/// Command "parameter information configuration", and two of its keys.
const CONFIGURE: u16 = 0x0100;
const POINT_HOST: u16 = 0x0006;
const WORK_MODE: u16 = 0x001A;
const SAMPLING: u8 = 1;

/// Configures a Mid-360 to measure, and to send its points here.
#[derive(Debug)]
pub(super) struct LivoxHost {
    host: String,
    /// Own port for points.
    port: u16,
}

impl LivoxHost {
    /// `None` without `host`: Livox's own program has configured it.
    pub(super) fn new(config: &DeviceConfig) -> Option<Self> {
        let port = match config.address() {
            Ok(Address::UdpListen(own)) => own.port(),
            _ => return None,
        };
        Some(Self {
            host: config.host(COMMAND_PORT)?,
            port,
        })
    }
}

impl Preparation for LivoxHost {
    fn name(&self) -> &'static str {
        "the sensor's configuration"
    }

    fn address(&self) -> Address {
        Address::Udp(self.host.clone())
    }

    fn request(&self, own: IpAddr) -> Vec<u8> {
        let own = match own {
            IpAddr::V4(own) => own.octets(),
            // A sensor with an IPv4 address is not reached from another.
            IpAddr::V6(_) => [0; 4],
        };
        let mut data = [2_u16, 0, POINT_HOST, 8].map(u16::to_le_bytes).concat();
        data.extend(own);
        let words = [self.port, POINT_PORT, WORK_MODE, 1];
        data.extend(words.map(u16::to_le_bytes).concat());
        data.push(SAMPLING);
        let mut request = vec![MARK, 0];
        request.extend(((HEADER + data.len()) as u16).to_le_bytes());
        request.extend(1_u32.to_le_bytes());
        request.extend(CONFIGURE.to_le_bytes());
        // A request, of a host; reserved.
        request.extend([0; 8]);
        request.extend(crc16(&request).to_le_bytes());
        request.extend(crc32fast::hash(&data).to_le_bytes());
        request.extend(data);
        request
    }

    fn take(&mut self, reply: &[u8]) -> Result<(), String> {
        let half = |at: usize| u16::from_le_bytes([reply[at], reply[at + 1]]);
        let is_reply = reply.len() == HEADER + 3
            && reply[0] == MARK
            && usize::from(half(2)) == reply.len()
            && half(8) == CONFIGURE
            && reply[10..12] == [1, 1]
            && half(18) == crc16(&reply[..18]);
        if !is_reply {
            return Err("a reply that is none".to_owned());
        }
        match reply[HEADER] {
            0 => Ok(()),
            code => {
                let key = half(HEADER + 1);
                Err(format!(
                    "the sensor refuses key {key:#06x} with code {code}"
                ))
            }
        }
    }
}

/// CRC-16/CCITT-FALSE.
fn crc16(bytes: &[u8]) -> u16 {
    let shift = |crc: u16, _bit| (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x1021 };
    let byte = |crc: u16, byte: &u8| (0..8).fold(crc ^ (u16::from(*byte) << 8), shift);
    bytes.iter().fold(0xFFFF, byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(kind: &str, more: &str) -> DeviceConfig {
        let port = if kind == "livox" { 56_301 } else { 7502 };
        let text = format!("kind = \"{kind}\"\nudp_listen = \"0.0.0.0:{port}\"\n{more}");
        toml::from_str(&text).unwrap()
    }

    #[test]
    fn metadata_are_asked_for_and_taken() {
        let mut metadata = OusterMetadata::new(&config("ouster", "host = \"os-1.local\"")).unwrap();
        assert_eq!(metadata.address(), Address::Tcp("os-1.local:80".to_owned()));
        let request = String::from_utf8(metadata.request([10, 0, 0, 1].into())).unwrap();
        assert!(
            request.starts_with("GET /api/v1/sensor/metadata HTTP/1.0\r\nHost: os-1.local:80\r\n")
        );
        for (reply, says) in [
            ("", "the reply is no HTTP"),
            (
                "HTTP/1.1 404 Not Found\r\n\r\n",
                "\"HTTP/1.1 404 Not Found\"; of firmware without",
            ),
            ("ICY 200 OK\r\n\r\n", "\"ICY 200 OK\""),
            ("HTTP/1.1 200 OK\r\n\r\n<html>", "the metadata is no JSON"),
            ("HTTP/1.1 200 OK\r\n\r\n{}", "no usable `pixels_per_column`"),
        ] {
            let refused = metadata.take(reply.as_bytes()).unwrap_err();
            assert!(refused.contains(says), "{refused}");
            assert!(metadata.ouster().is_none());
        }
    }

    #[test]
    fn a_mid360_is_configured_to_send_here() {
        let mut host = LivoxHost::new(&config("livox", "host = \"192.168.1.112\"")).unwrap();
        assert_eq!(
            host.address(),
            Address::Udp("192.168.1.112:56100".to_owned())
        );
        let request = host.request([192, 168, 1, 5].into());
        // By the document, without its checksums.
        let expected = [
            0xAA, 0, 45, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, // header
            2, 0, 0, 0, 6, 0, 8, 0, 192, 168, 1, 5, 0xED, 0xDB, 0xEC, 0xDB, // points
            0x1A, 0, 1, 0, 1, // work mode
        ];
        assert_eq!([&request[..18], &request[24..]].concat(), expected);
        // The check value of this checksum.
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(request[18..20], crc16(&request[..18]).to_le_bytes());
        assert_eq!(
            request[20..24],
            crc32fast::hash(&request[24..]).to_le_bytes()
        );

        let reply = |code: u8, key: u16| {
            let mut reply = request[..18].to_vec();
            reply[2] = 27;
            reply[10..12].fill(1);
            reply.extend(crc16(&reply).to_le_bytes());
            reply.extend([0; 4]);
            reply.push(code);
            reply.extend(key.to_le_bytes());
            reply
        };
        assert_eq!(host.take(&reply(0, 0)), Ok(()));
        let refused = "the sensor refuses key 0x0006 with code 33";
        assert_eq!(host.take(&reply(0x21, 6)), Err(refused.to_owned()));
        let mut damaged = reply(0, 0);
        damaged[4] = 7;
        for bytes in [&damaged[..], &[], &request] {
            assert_eq!(host.take(bytes), Err("a reply that is none".to_owned()));
        }
        assert!(LivoxHost::new(&config("livox", "")).is_none());
    }
}
