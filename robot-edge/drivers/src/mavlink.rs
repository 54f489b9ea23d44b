//! `MAVLink` 2 with an autopilot that runs `ArduPilot` Rover, on wheels or in water.
//!
//! The motor guard owns the link. It sends what this module encodes and forwards what it receives, unparsed, through a
//! pipe ([`Autopilot`] reads it). Messages, their layouts and checksums are those of the official definitions
//! (`ardupilotmega.xml`), from the crate `mavlink`; framing: mavlink.io/en/guide/serialization.html.
//!
//! Facts of `ArduPilot` are from its source, `Rover/GCS_MAVLink_Rover.cpp`, `mode_guided.cpp` and `mode.h`: it takes
//! velocities in mode GUIDED alone, once its EKF has an origin, and stops when none came for `GUID_TIMEOUT` (3 s). It
//! does not know the frame `BODY_FRD`: `BODY_NED` has the same axes. The speed is the length of the vector (vx, vy), with
//! the sign of vx, and at most `WP_SPEED`. The tests of this codec are against pymavlink; it was never tried on hardware.

mod session;

use mavlink::dialects::ardupilotmega::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavDistanceSensor, MavFrame,
    MavMessage, MavModeFlag, MavState, MavType, OBSTACLE_DISTANCE_DATA, PositionTargetTypemask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{MavHeader, MavlinkVersion, Message as _};

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

pub use session::{Autopilot, AutopilotState, AutopilotStatus};

/// The component of an autopilot (`MAV_COMP_ID_AUTOPILOT1`).
const AUTOPILOT: u8 = 1;

/// Begins a frame of version 2.
const START: u8 = 0xFD;
const HEADER_BYTES: usize = 10;
const CRC_BYTES: usize = 2;
const SIGNATURE_BYTES: usize = 13;
/// The incompatibility flag of a frame with a signature; others are not known.
const IS_SIGNED: u8 = 1;

/// Number of mode GUIDED of a rover.
pub const GUIDED: u32 = 15;

/// What is requested of the autopilot: message number and rate, hertz.
const WANTED: [(u32, f32); 6] = [
    (30, 20.0),    // ATTITUDE
    (33, 5.0),     // GLOBAL_POSITION_INT
    (24, 2.0),     // GPS_RAW_INT
    (1, 1.0),      // SYS_STATUS
    (132, 10.0),   // DISTANCE_SENSOR
    (11_038, 5.0), // WATER_DEPTH, of boats
];

/// A message of a system.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Number of the system that sent it.
    pub system: u8,
    /// Its component.
    pub component: u8,
    content: MavMessage,
}

/// Whether these received bytes begin with a frame of the autopilot of this system.
pub fn comes_from(system: u8, bytes: &[u8]) -> bool {
    matches!(bytes, &[START, _, _, _, _, sender, AUTOPILOT, ..] if sender == system)
}

/// Finds messages in a stream of bytes.
pub type MavlinkDecoder = StreamDecoder<Message>;

impl Message {
    /// Of a velocity that is sent to an autopilot: m/s ahead, and rad/s counter-clockwise from above.
    pub const fn velocity(&self) -> Option<[f32; 2]> {
        match &self.content {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => {
                Some([target.vx, -target.yaw_rate])
            }
            _ => None,
        }
    }
}

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        match before_mark(bytes, &[START]) {
            0 => {}
            length => return Front::Skip(DropReason::Garbage, length),
        }
        let &[
            _,
            length,
            flags,
            _,
            _,
            system,
            component,
            id_low,
            id_middle,
            id_high,
            ..,
        ] = bytes
        else {
            return Front::Incomplete;
        };
        if flags & !IS_SIGNED != 0 {
            return Front::Skip(DropReason::Garbage, 1);
        }
        let payload_end = HEADER_BYTES + usize::from(length);
        let signature = usize::from(flags) * SIGNATURE_BYTES;
        let total = payload_end + CRC_BYTES + signature;
        if bytes.len() < total {
            return Front::Incomplete;
        }
        let id = u32::from_le_bytes([id_low, id_middle, id_high, 0]);
        let extra = MavMessage::extra_crc(id);
        let crc = mavlink::calculate_crc(&bytes[1..payload_end], extra).to_le_bytes();
        if bytes[payload_end..payload_end + CRC_BYTES] != crc {
            // The checksum of an unknown message is not known either: it may be no message at all.
            let is_known = MavMessage::default_message_from_id(id).is_some();
            let reason = if is_known {
                DropReason::Checksum
            } else {
                DropReason::UnknownKind
            };
            return Front::Skip(reason, if is_known { 1 } else { total });
        }
        match MavMessage::parse(MavlinkVersion::V2, id, &bytes[HEADER_BYTES..payload_end]) {
            Ok(content) => {
                let message = Self {
                    system,
                    component,
                    content,
                };
                Front::Message(message, total)
            }
            Err(_) => Front::Skip(DropReason::Field, total),
        }
    }
}

/// Encodes what is sent to an autopilot; numbers the frames.
#[derive(Clone, Debug)]
pub struct Encoder {
    own: MavHeader,
    /// Number of the autopilot's system.
    target: u8,
    next_wanted: usize,
}

impl Encoder {
    /// `system`, `component`: of this computer. `target`: number of the autopilot's system.
    pub const fn new((system, component): (u8, u8), target: u8) -> Self {
        Self {
            own: MavHeader {
                system_id: system as u32,
                component_id: component,
                sequence: 0,
            },
            target,
            next_wanted: 0,
        }
    }

    /// A velocity of the vehicle: m/s ahead, rad/s counter-clockwise from above. `time_ms`: since the start of any clock.
    #[expect(
        deprecated,
        reason = "Rover ignores a velocity in the frame that supersedes BODY_NED"
    )]
    pub fn velocity(&mut self, linear_mps: f32, angular_radps: f32, time_ms: u32) -> Vec<u8> {
        type Mask = PositionTargetTypemask;
        let ignored = Mask::POSITION_TARGET_TYPEMASK_X_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_Y_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_Z_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_AX_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_AY_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_AZ_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_YAW_IGNORE;
        let data = SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: time_ms,
            vx: linear_mps,
            // Down is the axis: clockwise counts.
            yaw_rate: -angular_radps,
            type_mask: ignored,
            target_system: self.target,
            target_component: AUTOPILOT,
            coordinate_frame: MavFrame::MAV_FRAME_BODY_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        };
        self.frame(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(data))
    }

    /// That this computer is here; once a second.
    pub fn heartbeat(&mut self) -> Vec<u8> {
        self.frame(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        }))
    }

    /// Requests one of the messages that are read, the next one at each call: an autopilot that has started again
    /// sends all of them after a few calls.
    pub fn request_rate(&mut self) -> Vec<u8> {
        let (id, rate_hz) = WANTED[self.next_wanted % WANTED.len()];
        self.next_wanted = (self.next_wanted + 1) % WANTED.len();
        let period_us = 1e6 / rate_hz;
        self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id as f32, period_us])
    }

    /// Requests mode GUIDED. The vehicle may refuse it.
    pub fn request_guided(&mut self) -> Vec<u8> {
        let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
        let parameters = [f32::from(custom), GUIDED as f32];
        self.command(MavCmd::MAV_CMD_DO_SET_MODE, parameters)
    }

    /// Distances of obstacles in centimetres, clockwise in sectors of 5 degrees, the middle of the first one ahead: `max_cm` + 1 where there is none
    /// up to `max_cm`, [`u16::MAX`] where it is not known. `time_us`: since the start of any clock.
    pub fn obstacle_distance(
        &mut self,
        distances: [u16; 72],
        max_cm: u16,
        time_us: u64,
    ) -> Vec<u8> {
        /// Degrees.
        const INCREMENT: u8 = 5;
        self.frame(&MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
            time_usec: time_us,
            distances,
            min_distance: 1,
            max_distance: max_cm,
            sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER,
            increment: INCREMENT,
            increment_f: INCREMENT.into(),
            angle_offset: 0.0,
            frame: MavFrame::MAV_FRAME_BODY_FRD,
        }))
    }

    fn command(&mut self, command: MavCmd, [param1, param2]: [f32; 2]) -> Vec<u8> {
        self.frame(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            command,
            target_system: self.target,
            target_component: AUTOPILOT,
            ..COMMAND_LONG_DATA::DEFAULT
        }))
    }

    fn frame(&mut self, message: &MavMessage) -> Vec<u8> {
        let mut bytes = Vec::new();
        // Writing to memory does not fail.
        drop(mavlink::write_v2_msg(&mut bytes, self.own, message));
        self.own.sequence = self.own.sequence.wrapping_add(1);
        bytes
    }
}

#[cfg(test)]
mod tests;
