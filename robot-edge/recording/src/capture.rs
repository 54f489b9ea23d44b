//! Captures of a network (`.pcap`, `.pcapng`) with the packets of lidars.
//!
//! Velodyne's packets are found by their length. Ouster's need the metadata of the sensor: a `.json` in the folder of the capture
//! whose name begins as that of the capture does.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use etherparse::defrag::IpDefragPool;
use etherparse::{SlicedPacket, TransportSlice, UdpSlice};
use lidar::Sensor;
use lidar::ouster::Ouster;
use measurement::Stream;
use measurement::drops::DropReason;
use measurement::time::RobotTime;
use pcap_file::pcap::PcapReader;
use pcap_file::pcapng::{Block, PcapNgReader};
use pcap_file::{DataLink, PcapError};

use super::{Position, RecordingError, Selection};
use crate::messages::{MessageRecording, Messages};

/// Type of a stream of packets of a lidar.
pub const LIDAR_PACKETS: &str = "lidar packets";

/// Fragments wait no longer for the rest of their datagram.
const FRAGMENT_PATIENCE_NS: i64 = 1_000_000_000;

/// The first bytes of both formats, in both byte orders and with both units of time.
const MAGICS: [[u8; 4]; 5] = [
    [0xD4, 0xC3, 0xB2, 0xA1],
    [0xA1, 0xB2, 0xC3, 0xD4],
    [0x4D, 0x3C, 0xB2, 0xA1],
    [0xA1, 0xB2, 0x3C, 0x4D],
    [0x0A, 0x0D, 0x0D, 0x0A],
];

/// Whether a file that begins so is a capture.
pub(super) fn is_capture(beginning: &[u8]) -> bool {
    MAGICS.iter().any(|magic| beginning.starts_with(magic))
}

/// Reads the lidar packets of a capture.
pub(crate) struct CaptureReader {
    frames: Frames,
    link: DataLink,
    fragments: IpDefragPool<i64, ()>,
    newest_ns: i64,
    ouster: Option<Ouster>,
    selection: Selection,
    messages: Messages,
    position: Position,
}

enum Frames {
    Pcap(PcapReader<BufReader<File>>),
    PcapNg(PcapNgReader<BufReader<File>>),
}

/// A frame of the network: time of its capture, nanoseconds since 1970, and its bytes.
type Frame = (i64, Vec<u8>);

impl Frames {
    fn next(&mut self) -> Option<Result<Frame, PcapError>> {
        match self {
            Self::Pcap(reader) => reader.next_packet().map(|packet| {
                let packet = packet?;
                Ok((packet.timestamp.as_nanos() as i64, packet.data.into_owned()))
            }),
            Self::PcapNg(reader) => loop {
                match reader.next_block()? {
                    Ok(Block::EnhancedPacket(packet)) => {
                        let frame = (packet.timestamp.as_nanos() as i64, packet.data.into_owned());
                        return Some(Ok(frame));
                    }
                    Ok(_) => {}
                    Err(error) => return Some(Err(error)),
                }
            },
        }
    }
}

impl CaptureReader {
    /// Opens the capture at `path`.
    pub(crate) fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let io_error = RecordingError::io(path);
        let damaged = |error: PcapError| RecordingError::Damaged {
            path: path.to_owned(),
            offset: 0,
            what: error.to_string(),
            remedy: "Nothing was captured, or it was not copied to its end: copy it again",
        };
        let open = || File::open(path).map(|file| BufReader::with_capacity(1 << 16, file));
        let mut magic = [0; 4];
        open()
            .and_then(|mut file| file.read_exact(&mut magic))
            .map_err(io_error)?;
        let file = open().map_err(io_error)?;
        let bytes_total = file.get_ref().metadata().map_err(io_error)?.len();
        let (frames, link) = if magic == MAGICS[4] {
            let reader = PcapNgReader::new(file).map_err(damaged)?;
            (Frames::PcapNg(reader), DataLink::ETHERNET)
        } else {
            let reader = PcapReader::new(file).map_err(damaged)?;
            let link = reader.header().datalink;
            (Frames::Pcap(reader), link)
        };
        Ok(Self {
            frames,
            link,
            fragments: IpDefragPool::new(),
            newest_ns: 0,
            ouster: ouster_beside(path)?,
            selection,
            messages: Messages::default(),
            position: Position {
                bytes_read: 0,
                bytes_total,
            },
        })
    }

    /// Takes in the next frame; `false` at the end.
    fn read_record(&mut self) -> bool {
        let (at_ns, bytes) = match self.frames.next() {
            None => return false,
            Some(Ok(frame)) => frame,
            Some(Err(error)) => {
                let at = self.position.bytes_read;
                let reason = match error {
                    PcapError::IncompleteBuffer | PcapError::IoError(_) => DropReason::CutOff,
                    _ => DropReason::Damaged,
                };
                self.messages.losses_mut().add(reason, || {
                    format!("about byte {at}: {error}; the rest is not read")
                });
                return false;
            }
        };
        // The headers of the file's records are small.
        self.position.bytes_read =
            (self.position.bytes_read + 16 + bytes.len() as u64).min(self.position.bytes_total);
        self.newest_ns = self.newest_ns.max(at_ns);
        let sliced = match self.link {
            DataLink::RAW | DataLink::IPV4 | DataLink::IPV6 => SlicedPacket::from_ip(&bytes),
            DataLink::LINUX_SLL => SlicedPacket::from_linux_sll(&bytes),
            // A word that names the family.
            DataLink::NULL | DataLink::LOOP => {
                SlicedPacket::from_ip(bytes.get(4..).unwrap_or_default())
            }
            _ => SlicedPacket::from_ethernet(&bytes),
        };
        let Ok(sliced) = sliced else {
            // Frames of other protocols.
            return true;
        };
        let stamp = RobotTime::from_nanos(at_ns);
        if let Some(TransportSlice::Udp(udp)) = &sliced.transport {
            self.take_datagram(stamp, udp.destination_port(), udp.payload());
        } else if let Ok(Some(whole)) = self.fragments.process_sliced_packet(&sliced, at_ns, ()) {
            if let Ok(udp) = UdpSlice::from_slice(&whole.payload) {
                self.take_datagram(stamp, udp.destination_port(), udp.payload());
            }
            let newest_ns = self.newest_ns;
            self.fragments
                .retain(|since_ns| newest_ns - since_ns < FRAGMENT_PATIENCE_NS);
        }
        true
    }

    fn take_datagram(&mut self, stamp: RobotTime, port: u16, payload: &[u8]) {
        let ouster = self.ouster.as_ref();
        let ouster = ouster.filter(|ouster| ouster.packet_bytes() == payload.len());
        let (is_lidar, frame) = match ouster {
            Some(_) => (true, "os_sensor"),
            None => (payload.len() == lidar::velodyne::PACKET, "velodyne"),
        };
        let type_name = if is_lidar { LIDAR_PACKETS } else { "UDP" };
        let stream = Stream {
            name: format!("/udp_{port}"),
            type_name: type_name.to_owned(),
        };
        let is_read = is_lidar && self.selection.contains(&stream.name);
        let Some(id) = self.messages.stream(&stream, is_lidar) else {
            return;
        };
        self.messages.take(id, None, Some(stamp), &[]);
        if !is_read {
            return;
        }
        self.messages.add_lidar(id, frame.into(), || match ouster {
            Some(ouster) => Sensor::Ouster(Box::new(ouster.clone())),
            None => Sensor::Velodyne(Box::default()),
        });
        self.messages.take_packet(id, stamp, payload);
    }
}

/// The sensor of the metadata beside the capture: of several that fit, that with the longest name.
fn ouster_beside(path: &Path) -> Result<Option<Ouster>, RecordingError> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let entries = std::fs::read_dir(&folder).map_err(RecordingError::io(&folder))?;
    let fits = |path: &PathBuf| {
        let own = path.file_stem().unwrap_or_default().to_string_lossy();
        path.extension()
            .is_some_and(|extension| extension == "json")
            && stem.starts_with(&*own)
    };
    let metadata = entries.flatten().map(|entry| entry.path()).filter(fits);
    let metadata = metadata.max_by_key(|path| path.as_os_str().len());
    let Some(metadata) = metadata else {
        return Ok(None);
    };
    let text = std::fs::read_to_string(&metadata).map_err(RecordingError::io(&metadata))?;
    let ouster = Ouster::new(&text).map_err(|error| RecordingError::Io {
        path: metadata,
        source: io::Error::new(io::ErrorKind::InvalidData, error),
    })?;
    Ok(Some(ouster))
}

impl MessageRecording for CaptureReader {
    fn messages(&self) -> &Messages {
        &self.messages
    }

    fn messages_mut(&mut self) -> &mut Messages {
        &mut self.messages
    }

    fn step(&mut self) -> Result<bool, RecordingError> {
        let has_more = self.read_record();
        if !has_more {
            self.position.bytes_read = self.position.bytes_total;
        }
        Ok(has_more)
    }

    fn position(&self) -> Position {
        self.position
    }
}
