//! The emulated devices of a vehicle: its sensors, which send what the simulation measures, and its motor controller,
//! whose encoders count the turns of the simulated wheels.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use emulators::deltat::Deltat;
use emulators::dynamixel::XSeries;
use emulators::ldlrs::LdLrs;
use emulators::lms111::Lms111;
use emulators::mti::{Mti, Sample};
use emulators::nmea::{Nmea, Position};
use emulators::{Device, Emulator};
use measurement::{Measurement, MeasurementData};
use network::clock;
use simulation::World;
use simulation::source::START;
use simulation::tilt_servo::TiltServo;
use simulation::vehicle::Carriage;

use crate::live::emulator::Emulator as Ax3500;

/// Of a wheel encoder, if the vehicle has any.
pub(super) fn pulses_per_turn(world: &World) -> Option<u32> {
    match world.simulated_vehicle().carriage {
        Carriage::Wheels(chassis) => Some(chassis.encoders?.pulses_per_turn),
        Carriage::Level | Carriage::Hull(_) => None,
    }
}

/// A device that gets its measurements from the simulation.
pub(super) struct Fed<D> {
    pub(super) emulator: Emulator<D>,
    /// Uptime of the device when the simulation begins.
    began: Duration,
}

impl<D: Device> Fed<D> {
    fn new(emulator: Emulator<D>) -> Self {
        Self {
            emulator,
            began: Duration::ZERO,
        }
    }

    fn begin(&mut self, after: Duration) {
        self.began = self.emulator.uptime() + after;
    }

    fn feed(&self, at: Duration, act: impl FnOnce(&mut D, Duration)) {
        self.emulator.with(|device| act(device, self.began + at));
    }
}

/// The devices of one vehicle.
pub(super) struct Devices {
    pub(super) controller: Fed<Controller>,
    attitude: Fed<Mti>,
    land_laser: Option<Fed<Lms111>>,
    boat_laser: Option<Fed<LdLrs>>,
    sonar: Option<Fed<Deltat>>,
    receiver: Option<Fed<Nmea>>,
    servo: Option<Fed<XSeries>>,
    /// Times at which the edge asked the servo for its angle, seconds since the simulation began.
    pub(super) asked_s: Arc<Mutex<Vec<f64>>>,
}

impl Devices {
    pub(super) fn of(world: &World) -> Self {
        let vehicle = world.simulated_vehicle();
        let is_boat = vehicle.gps.is_some();
        let sonar = || {
            let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            let host = free.local_addr().unwrap();
            drop(free);
            Fed::new(Emulator::to_udp(Deltat::default(), host))
        };
        let mut receiver = Nmea::default();
        // The simulation's first fix ends this.
        receiver.has_no_fix = true;
        let servo = |_| Fed::new(Emulator::on_serial(XSeries::default()));
        Self {
            controller: Fed::new(Emulator::on_serial(Controller::new(pulses_per_turn(world)))),
            attitude: Fed::new(Emulator::on_serial(Mti::default())),
            land_laser: (!is_boat).then(|| Fed::new(Emulator::on_tcp(Lms111::default()))),
            boat_laser: is_boat.then(|| Fed::new(Emulator::on_tcp(LdLrs::default()))),
            sonar: is_boat.then(sonar),
            receiver: is_boat.then(|| Fed::new(Emulator::on_serial(receiver))),
            servo: vehicle.laser.tilt.clone().map(servo),
            asked_s: Arc::default(),
        }
    }

    /// The part of the edge's configuration file that names these devices.
    pub(super) fn configuration(&self) -> String {
        let mut text = String::new();
        let mut device = |name: &str, kind: &str, at: &str, address: &str, more: &str| {
            text.extend([format!(
                "[devices.{name}]\nkind = \"{kind}\"\n{at} = \"{address}\"\n{more}"
            )]);
        };
        let attitude = &self.attitude.emulator.address;
        if let Some(laser) = &self.land_laser {
            // A fixed laser, that of Holos, scans 120°, a tilting one 270°.
            let half_deg = if self.servo.is_some() { 135 } else { 60 };
            let more = format!(
                "rate_hz = 25\nresolution_deg = 0.25\nsector_from_deg = -{half_deg}\nsector_to_deg = {half_deg}\n"
            );
            device("laser", "sick_cola", "tcp", &laser.emulator.address, &more);
            device("ahrs", "xsens", "serial", attitude, "");
        } else {
            device("imu", "xsens", "serial", attitude, "");
        }
        if let Some(laser) = &self.boat_laser {
            device("laser", "sick_ldlrs", "tcp", &laser.emulator.address, "");
        }
        if let Some(sonar) = &self.sonar {
            let address = &sonar.emulator.address;
            device("sonar", "imagenex_deltat", "udp_listen", address, "");
        }
        if let Some(receiver) = &self.receiver {
            device("gps", "nmea", "serial", &receiver.emulator.address, "");
        }
        if let Some(servo) = &self.servo {
            let rate_hz = if self.land_laser.is_some() { 100 } else { 50 };
            let more = format!(
                "servo = \"x_series\"\nservo_id = 1\njoint = \"laser_tilt_joint\"\nrate_hz = {rate_hz}\n"
            );
            device(
                "servo",
                "dynamixel",
                "serial",
                &servo.emulator.address,
                &more,
            );
        }
        if self.boat_laser.is_some() {
            text += "[sensors.laser]\ntopic = \"/laser\"\n";
        }
        text
    }

    /// The edge has configured every device that it configures.
    pub(super) fn are_ready(&self) -> bool {
        let mut all = self.attitude.emulator.with(|device| device.is_measuring());
        if let Some(laser) = &self.land_laser {
            all &= laser.emulator.with(|device| device.is_subscribed());
        }
        if let Some(laser) = &self.boat_laser {
            all &= laser.emulator.with(|device| device.is_sending());
        }
        all
    }

    /// The simulation begins `after` this call.
    pub(super) fn begin(&mut self, tilt: Option<TiltServo>, after: Duration) {
        self.controller.begin(after);
        self.attitude.begin(after);
        self.land_laser
            .iter_mut()
            .for_each(|device| device.begin(after));
        self.boat_laser
            .iter_mut()
            .for_each(|device| device.begin(after));
        self.sonar.iter_mut().for_each(|device| device.begin(after));
        self.receiver
            .iter_mut()
            .for_each(|device| device.begin(after));
        if let (Some(servo), Some(tilt)) = (&mut self.servo, tilt) {
            servo.begin(after);
            let began = servo.began;
            servo.emulator.with(|device| {
                let asked_s = Arc::clone(&self.asked_s);
                let angle_rad = move |uptime: Duration| {
                    let time_s = uptime.as_secs_f64() - began.as_secs_f64();
                    asked_s.lock().unwrap().push(time_s);
                    tilt.angle_rad(time_s)
                };
                device.angle_rad = Some(Box::new(angle_rad));
            });
        }
    }

    /// Gives a measurement of the simulation to the device that sends it to the edge.
    pub(super) fn feed(&self, measurement: &Measurement) {
        let at = measurement.stamp.since(START).as_nanos();
        let at = Duration::from_nanos(at.unsigned_abs());
        match &measurement.data {
            MeasurementData::Scan { scan, .. } => {
                let ranges_m = &scan.ranges_m;
                if let Some(laser) = &self.land_laser {
                    laser.feed(at, |device, at| device.feed(at, ranges_m));
                } else if &*measurement.frame == "sonar" {
                    let sonar = self.sonar.as_ref().unwrap();
                    sonar.feed(at, |device, at| device.feed(at, ranges_m));
                } else {
                    let laser = self.boat_laser.as_ref().unwrap();
                    laser.feed(at, |device, at| device.feed(at, ranges_m));
                }
            }
            MeasurementData::Imu(imu) => {
                let [x, y, z, w] = imu.orientation_xyzw.unwrap().map(|part| part as f32);
                let sample = Sample {
                    attitude_wxyz: [w, x, y, z],
                    force_mps2: imu.linear_acceleration_mps2.map(|part| part as f32),
                    rates_radps: imu.angular_velocity_radps.map(|part| part as f32),
                };
                self.attitude.feed(at, |device, at| device.feed(at, sample));
            }
            MeasurementData::Fix(fix) => {
                let position = Position {
                    latitude_deg: fix.latitude_deg,
                    longitude_deg: fix.longitude_deg,
                    height_m: fix.altitude_m,
                };
                let receiver = self.receiver.as_ref().unwrap();
                receiver.feed(at, |device, at| {
                    device.has_no_fix = false;
                    device.feed(at, position);
                });
            }
            MeasurementData::Joints(joints) => {
                if let [(_, left_rad), (_, right_rad)] = joints[..] {
                    let turned_rad = [left_rad, right_rad];
                    let act =
                        |device: &mut Controller, at| device.wheels.push_back((at, turned_rad));
                    self.controller.feed(at, act);
                }
            }
            MeasurementData::Transform { .. }
            | MeasurementData::Odometry { .. }
            | MeasurementData::Twist(_)
            | MeasurementData::Range(_)
            | MeasurementData::Bool(_)
            | MeasurementData::Cloud(_) => {}
        }
    }
}

/// The emulated AX3500, with encoders that count the turns of the simulated wheels.
pub(super) struct Controller {
    pub(super) ax3500: Ax3500,
    /// Angles of both wheels, each with the uptime at which the wheels have them.
    wheels: VecDeque<(Duration, [f64; 2])>,
    counts_per_turn: f64,
    /// The command that is being received.
    line: Vec<u8>,
}

impl Controller {
    fn new(pulses_per_turn: Option<u32>) -> Self {
        let mut ax3500 = Ax3500::new(clock::now());
        // Shorter than the real one: the edge waits for the watchdog when it starts.
        ax3500.watchdog_after = Duration::from_millis(600);
        Self {
            ax3500,
            wheels: VecDeque::new(),
            counts_per_turn: 4.0 * f64::from(pulses_per_turn.unwrap_or(0)),
            line: Vec::new(),
        }
    }

    /// Count of a channel's encoder, interpolated between the angles before and after.
    fn count(&mut self, channel: usize, uptime: Duration) -> i32 {
        while self.wheels.get(1).is_some_and(|(at, _)| *at <= uptime) {
            self.wheels.pop_front();
        }
        let angle_rad = match (self.wheels.front(), self.wheels.get(1)) {
            (Some((from, before)), Some((to, after))) if *from <= uptime => {
                let since_s = |at: Duration| at.saturating_sub(*from).as_secs_f64();
                let share = since_s(uptime) / since_s(*to);
                before[channel] + share * (after[channel] - before[channel])
            }
            (Some((_, angles)), _) => angles[channel],
            (None, _) => 0.0,
        };
        (angle_rad * self.counts_per_turn / TAU).round() as i32
    }
}

impl Device for Controller {
    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8> {
        let mut replies = Vec::new();
        for &byte in bytes {
            let reply = self.ax3500.receive(&[byte], clock::now());
            if byte != b'\r' {
                self.line.push(byte);
                replies.extend(reply);
                continue;
            }
            match *std::mem::take(&mut self.line) {
                [b'?', b'Q', encoder @ (b'0' | b'1')] => {
                    let count = self.count(usize::from(encoder - b'0'), uptime);
                    replies.extend(format!("\r{count:08X}\r").into_bytes());
                }
                _ => replies.extend(reply),
            }
        }
        replies
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        vec![self.ax3500.pass_time(clock::now())]
    }
}
