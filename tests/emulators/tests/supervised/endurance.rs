//! All devices in one run, taken away and given back again and again.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use drivers::Drivers;
use drivers::supervisor::Reading;
use emulators::deltat::Deltat;
use emulators::dynamixel::XSeries;
use emulators::hokuyo::Hokuyo;
use emulators::imagenex852::Imagenex852;
use emulators::ldlrs::LdLrs;
use emulators::livox::Points;
use emulators::lms111::Lms111;
use emulators::mti::Mti;
use emulators::nmea::Nmea;
use emulators::ping1d::Ping1d;
use emulators::rplidar::Rplidar;
use emulators::ublox::Ublox;
use emulators::{Device, Emulator};
use measurement::MeasurementData;
use measurement::time::Monotonic;

use crate::lidars::free_address;
use crate::recorded::{os0, vlp16};
use crate::rig::{BACK_WITHIN, PATIENCE, age, clock};

/// A device that can be taken away.
struct Removable {
    config: String,
    power: Box<dyn Fn(bool) + Send + Sync>,
    plug: Box<dyn Fn(bool) + Send + Sync>,
}

impl Removable {
    fn new<D: Device>(config: &str, emulator: Emulator<D>) -> Self {
        let config = config.replace("ADDRESS", &emulator.address);
        let emulator = std::sync::Arc::new(emulator);
        let same = std::sync::Arc::clone(&emulator);
        Self {
            config,
            power: Box::new(move |is_on| emulator.power(is_on)),
            plug: Box::new(move |is_in| same.plug(is_in)),
        }
    }
}

fn all() -> Vec<Removable> {
    let servo =
        "kind = 'dynamixel'\nserial = 'ADDRESS'\nservo = 'x_series'\nservo_id = 1\njoint = 'tilt'";
    let mut devices = vec![
        Removable::new(
            "kind = 'sick_cola'\ntcp = 'ADDRESS'\nrate_hz = 25",
            Emulator::on_tcp(Lms111::default()),
        ),
        Removable::new(
            "kind = 'xsens'\nserial = 'ADDRESS'",
            Emulator::on_serial(Mti::default()),
        ),
        Removable::new(
            "kind = 'nmea'\nserial = 'ADDRESS'",
            Emulator::on_serial(Nmea::default()),
        ),
        Removable::new(
            "kind = 'hokuyo'\ntcp = 'ADDRESS'",
            Emulator::on_tcp(Hokuyo::default()),
        ),
        Removable::new(
            "kind = 'imagenex852'\nserial = 'ADDRESS'",
            Emulator::on_serial(Imagenex852::default()),
        ),
        Removable::new(
            "kind = 'imagenex_deltat'\nudp_listen = 'ADDRESS'",
            Emulator::to_udp(Deltat::default(), free_address()),
        ),
        Removable::new(
            "kind = 'ping1d'\nudp = 'ADDRESS'",
            Emulator::on_udp(Ping1d::default()),
        ),
        Removable::new(
            "kind = 'sick_ldlrs'\ntcp = 'ADDRESS'",
            Emulator::on_tcp(LdLrs::default()),
        ),
        Removable::new(
            "kind = 'rplidar'\nserial = 'ADDRESS'",
            Emulator::on_usb(Rplidar::default()),
        ),
        Removable::new(
            "kind = 'ublox'\nserial = 'ADDRESS'",
            Emulator::on_usb(Ublox::default()),
        ),
        Removable::new(servo, Emulator::on_serial(XSeries::default())),
        Removable::new(
            "kind = 'livox'\nudp_listen = 'ADDRESS'",
            Emulator::to_udp(Points::default(), free_address()),
        ),
    ];
    devices.extend(vlp16().map(|packets| {
        Removable::new(
            "kind = 'velodyne'\nudp_listen = 'ADDRESS'",
            Emulator::to_udp(packets, free_address()),
        )
    }));
    devices.extend(os0().map(|(packets, metadata)| {
        let metadata = metadata.display();
        Removable::new(
            &format!("kind = 'ouster'\nudp_listen = 'ADDRESS'\nmetadata = '{metadata}'"),
            Emulator::to_udp(packets, free_address()),
        )
    }));
    devices
}

fn resident_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.unwrap()
        .trim()
        .trim_end_matches(" kB")
        .parse()
        .unwrap()
}

/// `CYCLES` of all devices together, 1000 if not set.
#[test]
#[ignore = "takes minutes"]
fn every_device_comes_back_within_two_seconds() {
    let cycles: usize = std::env::var("CYCLES").map_or(1000, |text| text.parse().unwrap());
    let devices = all();
    let each = cycles.div_ceil(devices.len());
    let texts: Vec<String> = devices
        .iter()
        .enumerate()
        .map(|(number, device)| format!("[d{number:02}]\n{}\n", device.config))
        .collect();
    let configs = toml::from_str(&texts.concat()).unwrap();
    let (sender, readings) = sync_channel::<Reading>(10_000);
    let drivers = Drivers::start(&configs, clock, &sender).unwrap();
    drop(sender);
    let newest = Mutex::new(vec![Monotonic::from_nanos(0); devices.len()]);
    let is_over = AtomicBool::new(false);
    let waits = Mutex::new(Vec::new());
    let newest_of = |number: usize| newest.lock().unwrap()[number];
    let wait_for = |what: &str, patience: Duration, is_so: &dyn Fn() -> bool| {
        let since = clock();
        while !is_so() {
            let waited = clock().since(since);
            assert!(
                waited < patience,
                "{what} in vain: {:#?}",
                drivers.statuses().now().collect::<Vec<_>>()
            );
            std::thread::sleep(Duration::from_millis(2));
        }
        clock().since(since)
    };
    let mut resident = Vec::new();
    std::thread::scope(|scope| {
        let (is_over, newest) = (&is_over, &newest);
        scope.spawn(move || {
            while !is_over.load(Ordering::Acquire) {
                let Ok(reading) = readings.recv_timeout(Duration::from_millis(50)) else {
                    continue;
                };
                assert!(
                    age(&reading) < Duration::from_millis(450),
                    "{:?}",
                    age(&reading)
                );
                let number = usize::from(reading.measurement.stream.0);
                newest.lock().unwrap()[number] = reading.arrived;
            }
        });
        let workers: Vec<_> = devices
            .iter()
            .enumerate()
            .map(|(number, device)| {
                let (wait_for, newest_of, waits, drivers) =
                    (&wait_for, &newest_of, &waits, &drivers);
                scope.spawn(move || {
                    wait_for("waited for the start", PATIENCE, &|| {
                        newest_of(number) > Monotonic::from_nanos(0)
                    });
                    for cycle in 0..each {
                        let take = if cycle % 2 == 0 {
                            &device.power
                        } else {
                            &device.plug
                        };
                        let lost = || {
                            drivers
                                .statuses()
                                .now()
                                .nth(number)
                                .unwrap()
                                .1
                                .lost_connections
                        };
                        let before = lost();
                        take(false);
                        wait_for("waited for the loss", PATIENCE, &|| lost() > before);
                        // Off for other times each cycle.
                        std::thread::sleep(Duration::from_millis(37 * (cycle as u64 % 20)));
                        let back_at = clock();
                        take(true);
                        let waited = wait_for("waited for its return", BACK_WITHIN, &|| {
                            newest_of(number) > back_at
                        });
                        waits.lock().unwrap().push(waited);
                    }
                })
            })
            .collect();
        let started = clock();
        while workers.iter().any(|worker| !worker.is_finished()) {
            resident.push((clock().since(started).as_secs_f64() / 3600.0, resident_kb()));
            std::thread::sleep(Duration::from_secs(1));
        }
        is_over.store(true, Ordering::Release);
    });
    let waits = waits.into_inner().unwrap();
    assert_eq!(waits.len(), each * devices.len());
    let slowest = waits.iter().max().unwrap();
    // In the first half buffers grow to their size.
    let half = &resident[resident.len() / 2..];
    let ((from, kb), (to, last_kb)) = (half[0], half[half.len() - 1]);
    let slope = (last_kb as f64 - kb as f64) / 1000.0 / (to - from).max(1.0 / 60.0);
    println!(
        "{} cycles in {:.0} min, slowest return {slowest:?}; {} kB at the start, {kb} kB at half time, {last_kb} kB at the \
         end: {slope:.2} MB/h in the second half",
        waits.len(),
        to * 60.0,
        resident[0].1
    );
}

/// Ticks of processor time that the threads of this name took; 100 in a second.
fn processor_ticks(thread: &str) -> u64 {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let ticks = tasks.map(|task| {
        let stat = std::fs::read_to_string(task.unwrap().path().join("stat")).unwrap_or_default();
        let (name, rest) = stat.rsplit_once(')').unwrap_or_default();
        let fields = rest.split_whitespace().skip(11).take(2);
        let ticks: u64 = fields.map(|field| field.parse::<u64>().unwrap()).sum();
        if name.ends_with(thread) { ticks } else { 0 }
    });
    ticks.sum()
}

/// All devices at their full rates: processor time, and from the arrival of a sweep to its receiver.
#[test]
#[ignore = "measures"]
fn load_of_all_devices() {
    const TIME: Duration = Duration::from_secs(30);
    let devices = all();
    let texts: Vec<String> = devices
        .iter()
        .enumerate()
        .map(|(number, device)| format!("[d{number:02}]\n{}\n", device.config))
        .collect();
    let configs = toml::from_str(&texts.concat().replace("rate_hz = 25", "rate_hz = 50")).unwrap();
    let (sender, readings) = sync_channel::<Reading>(10_000);
    let drivers = Drivers::start(&configs, clock, &sender).unwrap();
    let is_measuring = || {
        drivers
            .statuses()
            .now()
            .all(|(_, status)| status.rate_hz > 0.0)
    };
    let since = clock();
    while !is_measuring() {
        assert!(clock().since(since) < PATIENCE, "{:?}", drivers.statuses());
        drop(readings.recv_timeout(Duration::from_millis(1)));
    }
    let (since, ticks) = (clock(), processor_ticks("devices"));
    let (mut delays, mut sweeps, mut beams) = (Vec::new(), 0, 0);
    while clock().since(since) < TIME {
        let Ok(reading) = readings.recv_timeout(Duration::from_millis(100)) else {
            continue;
        };
        delays.push(clock().since(reading.arrived));
        let data = &reading.measurement.data;
        sweeps += usize::from(data.is_scan());
        beams += match data {
            MeasurementData::Scan { scan, .. } => scan.ranges_m.len(),
            MeasurementData::Cloud(cloud) => cloud.points.len() + cloud.without_return as usize,
            _ => 0,
        };
    }
    let load = (processor_ticks("devices") - ticks) as f64 / TIME.as_secs_f64();
    delays.sort();
    println!(
        "{load:.1} % of a core; {} measurements, {sweeps} sweeps, {beams} beams in {TIME:?}; arrival to receiver: median \
         {:?}, 99 % {:?}, greatest {:?}",
        delays.len(),
        delays[delays.len() / 2],
        delays[delays.len() * 99 / 100],
        delays.last().unwrap()
    );
    for (name, status) in drivers.statuses().now() {
        println!("{name}: {:.1} Hz, lost {:?}", status.rate_hz, status.losses);
        assert!(status.losses.is_empty(), "{name}: {:?}", status.losses);
    }
}
