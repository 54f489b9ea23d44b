//! What an autopilot's messages mean: its state, attitude, position and depth.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    ATTITUDE_DATA, DISTANCE_SENSOR_DATA, GLOBAL_POSITION_INT_DATA, GpsFixType, HEARTBEAT_DATA,
    MavAutopilot, MavCmd, MavMessage, MavModeFlag, MavResult, MavSensorOrientation, MavState,
    MavType,
};
use measurement::{GeodeticFix, ImuSample, MeasurementData};

use super::{AUTOPILOT, MavlinkDecoder, Message};
use crate::clock_mapping::DeviceTime;
use crate::device::{Device, Event, Sample, Step};
use crate::gnss::enu_yaw_rad;
use crate::single_beam::single_beam;

/// Texts that wait to be shown. Of a flood the newest are lost, and counted.
const MAX_TEXTS: usize = 8;

/// Depths where the autopilot does not say which its sounder measures, metres.
const DEPTH_M: [f32; 2] = [0.3, 100.0];

/// What the newest heartbeat says, and what came with it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotState {
    /// Heartbeats received; its age is that of the last increase.
    pub heartbeats: u64,
    /// It is a ground vehicle or boat with `ArduPilot`.
    pub is_rover: bool,
    /// Its motors may turn.
    pub is_armed: bool,
    /// Number of its mode; [`super::GUIDED`] obeys velocities.
    pub mode: u32,
    /// It has a failsafe in force, or worse.
    pub has_failsafe: bool,
    /// Voltage of its battery, volts.
    pub battery_v: Option<f64>,
}

/// The state of an autopilot, for any thread; clones are the same state.
#[derive(Clone, Debug, Default)]
pub struct AutopilotStatus(Arc<Mutex<Shared>>);

#[derive(Debug, Default)]
struct Shared {
    state: AutopilotState,
    texts: VecDeque<String>,
    lost_texts: u64,
}

impl AutopilotStatus {
    /// The state, unless another thread writes right now.
    pub fn try_state(&self) -> Option<AutopilotState> {
        Some(self.0.try_lock().ok()?.state)
    }

    /// What it said since the last call; nothing while another thread writes.
    pub fn try_take_texts(&self) -> Vec<String> {
        let Ok(mut shared) = self.0.try_lock() else {
            return Vec::new();
        };
        let mut texts: Vec<_> = shared.texts.drain(..).collect();
        let lost = std::mem::take(&mut shared.lost_texts);
        if lost > 0 {
            texts.push(format!("{lost} more texts came at once and are not shown"));
        }
        texts
    }

    fn change(&self, change: impl FnOnce(&mut Shared)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Shared {
    fn push(&mut self, text: String) {
        if self.texts.len() < MAX_TEXTS {
            self.texts.push_back(text);
        } else {
            self.lost_texts += 1;
        }
    }
}

/// An autopilot whose link another process owns. It has three outputs: attitude, position and depth.
#[derive(Debug)]
pub struct Autopilot {
    system: u8,
    status: AutopilotStatus,
    /// Of the receiver's last message, as `sensor_msgs/NavSatStatus` counts.
    fix_status: Option<i8>,
    /// Boats send each depth twice.
    has_water_depth: bool,
}

impl Autopilot {
    /// Names of the outputs, in the order of their numbers.
    pub const OUTPUTS: [&'static str; 3] = ["attitude", "position", "depth"];

    /// The one of the system with this number; frames of others are ignored.
    pub fn new(system: u8, status: AutopilotStatus) -> Self {
        Self {
            system,
            status,
            fix_status: None,
            has_water_depth: false,
        }
    }

    fn heartbeat(&self, heartbeat: &HEARTBEAT_DATA) -> Event {
        let is_ardupilot = heartbeat.autopilot == MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
        let vehicle = match heartbeat.mavtype {
            MavType::MAV_TYPE_GROUND_ROVER => Some("rover"),
            MavType::MAV_TYPE_SURFACE_BOAT => Some("boat"),
            _ => None,
        };
        self.status.change(|shared| {
            let state = &mut shared.state;
            state.heartbeats += 1;
            state.is_rover = is_ardupilot && vehicle.is_some();
            let armed = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
            state.is_armed = heartbeat.base_mode.contains(armed);
            state.mode = heartbeat.custom_mode;
            state.has_failsafe = matches!(
                heartbeat.system_status,
                MavState::MAV_STATE_CRITICAL
                    | MavState::MAV_STATE_EMERGENCY
                    | MavState::MAV_STATE_POWEROFF
                    | MavState::MAV_STATE_FLIGHT_TERMINATION
            );
        });
        let name = if is_ardupilot {
            "ArduPilot"
        } else {
            "no ArduPilot"
        };
        let vehicle = vehicle.unwrap_or("no rover or boat");
        Event::Identity(format!("{name}, {vehicle}, system {}", self.system))
    }

    fn position(&self, position: &GLOBAL_POSITION_INT_DATA) -> Option<Event> {
        let status = self.fix_status.filter(|status| *status >= 0)?;
        let fix = GeodeticFix {
            latitude_deg: f64::from(position.lat) * 1e-7,
            longitude_deg: f64::from(position.lon) * 1e-7,
            altitude_m: f64::from(position.alt) * 1e-3,
            status,
            sigma_m: None,
        };
        Some(sample(MeasurementData::Fix(fix)))
    }
}

impl Device for Autopilot {
    type Decoder = MavlinkDecoder;

    fn connect(&mut self) -> MavlinkDecoder {
        self.fix_status = None;
        self.has_water_depth = false;
        MavlinkDecoder::default()
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, message: Message, _awaited: Option<usize>, events: &mut Vec<Event>) {
        if (message.system, message.component) != (self.system, AUTOPILOT) {
            return;
        }
        match message.content {
            MavMessage::HEARTBEAT(heartbeat) => events.push(self.heartbeat(&heartbeat)),
            MavMessage::ATTITUDE(attitude) => {
                let time = DeviceTime::counter(attitude.time_boot_ms, 1_000_000, 32);
                events.push(Event::Sample(Sample {
                    sent: Some(time),
                    age: Duration::ZERO,
                    data: MeasurementData::Imu(imu(&attitude)),
                }));
            }
            MavMessage::GPS_RAW_INT(gps) => self.fix_status = Some(fix_status(gps.fix_type)),
            MavMessage::GLOBAL_POSITION_INT(position) => events.extend(self.position(&position)),
            MavMessage::WATER_DEPTH(depth) => {
                self.has_water_depth = true;
                let range_m = if depth.healthy == 0 {
                    f64::NAN
                } else {
                    f64::from(depth.distance)
                };
                events.push(sample(single_beam(range_m, DEPTH_M)));
            }
            MavMessage::DISTANCE_SENSOR(range) => {
                let is_down =
                    range.orientation == MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270;
                if is_down && !self.has_water_depth {
                    events.push(distance(&range));
                }
            }
            MavMessage::SYS_STATUS(system) => {
                let is_known = system.voltage_battery != u16::MAX && system.voltage_battery != 0;
                let volts = is_known.then(|| f64::from(system.voltage_battery) * 1e-3);
                self.status.change(|shared| shared.state.battery_v = volts);
            }
            MavMessage::STATUSTEXT(text) => {
                if let Ok(text) = text.text.to_str() {
                    self.status.change(|shared| shared.push(text.to_owned()));
                }
            }
            MavMessage::COMMAND_ACK(ack)
                if ack.command == MavCmd::MAV_CMD_DO_SET_MODE
                    && ack.result != MavResult::MAV_RESULT_ACCEPTED =>
            {
                let text = format!("mode GUIDED was refused ({:?})", ack.result);
                self.status.change(|shared| shared.push(text));
            }
            // What is not used.
            _ => {}
        }
    }

    fn output(&self, data: &MeasurementData) -> u16 {
        match data {
            MeasurementData::Imu(_) => 0,
            MeasurementData::Fix(_) => 1,
            _ => 2,
        }
    }

    fn max_silence(&self) -> Duration {
        Duration::from_secs(3)
    }
}

/// Stamped with its arrival: several messages have the same time, which is the sending's, too.
fn sample(data: MeasurementData) -> Event {
    Event::Sample(Sample {
        sent: None,
        age: Duration::ZERO,
        data,
    })
}

/// From axes forward, right, down in north, east, down to axes forward, left, up in east, north, up.
fn imu(attitude: &ATTITUDE_DATA) -> ImuSample {
    let [roll, pitch, yaw] = [
        f64::from(attitude.roll),
        -f64::from(attitude.pitch),
        enu_yaw_rad(attitude.yaw.into()),
    ];
    let [(sr, cr), (sp, cp), (sy, cy)] =
        [roll, pitch, yaw].map(|angle| (libm::sin(angle / 2.0), libm::cos(angle / 2.0)));
    ImuSample {
        // Turned about z by yaw, then about y by pitch, then about x by roll.
        orientation_xyzw: Some([
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]),
        angular_velocity_radps: [
            attitude.rollspeed.into(),
            -f64::from(attitude.pitchspeed),
            -f64::from(attitude.yawspeed),
        ],
        // It sends none.
        linear_acceleration_mps2: [0.0; 3],
    }
}

/// As `sensor_msgs/NavSatStatus`: −1 no fix, 0 a fix, 1 with SBAS or DGPS, 2 with RTK.
const fn fix_status(fix: GpsFixType) -> i8 {
    match fix {
        GpsFixType::GPS_FIX_TYPE_NO_GPS
        | GpsFixType::GPS_FIX_TYPE_NO_FIX
        | GpsFixType::GPS_FIX_TYPE_2D_FIX => -1,
        GpsFixType::GPS_FIX_TYPE_DGPS => 1,
        GpsFixType::GPS_FIX_TYPE_RTK_FLOAT
        | GpsFixType::GPS_FIX_TYPE_RTK_FIXED
        | GpsFixType::GPS_FIX_TYPE_PPP => 2,
        _ => 0,
    }
}

/// Centimetres; a range at or beyond the greatest is no echo.
fn distance(range: &DISTANCE_SENSOR_DATA) -> Event {
    let metres = |centimetres: u16| f32::from(centimetres) / 100.0;
    let limits = [metres(range.min_distance), metres(range.max_distance)];
    sample(single_beam(metres(range.current_distance).into(), limits))
}
