//! Benchmark of a fleet with keys behind one `zenohd`: its processor time, memory and ages. One console is slow, one operator
//! floods, and the router is killed in the middle.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::thread::{self, sleep};
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, evaluate};
use foreshore_tests::operator::{Journal, Operator, connected};
use foreshore_tests::rig::udp::UdpRelay;
use measurement::time::Monotonic;
use network::clock::{self, sleep_until};
use network::credentials::Credentials;
use rustix::process::nice;
use serde_json::{Value, json};
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::shaped::shaped;
use crate::fleet::{Fleet, quic, text};
use crate::processes::{Running, assert_same_maps, free_port, start, zenohd};
use crate::rng::SeededRng;
use crate::teleop::figures::{LET_GO, PRESSED, latencies};
use crate::teleop::robot::{LIMITS, at};

/// The first two are driven by operators, the other driving ones by their world.
const VEHICLES: usize = 50;
const DRIVING: usize = 10;
/// Each watches another vehicle, from the first on; the last is slow.
const CONSOLES: usize = 20;
/// Messages of the flood, in each 20 ms.
const FLOOD_AT_ONCE: usize = 20;
/// From the start of the first vehicle until everything is connected, at most.
const STARTUP: Duration = Duration::from_mins(1);

fn name(vehicle: usize) -> String {
    format!("v{vehicle}")
}

/// Writes `rooms` with a path that goes round for hours, and with one that ends after four metres.
fn write_worlds(folder: &Path) {
    let rooms = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../robot-edge/simulation/worlds/rooms.toml"
    );
    let world = text(rooms);
    let (before, path) = world.split_once("waypoints = [\n").unwrap();
    let (path, after) = path.split_once("\n]\n").unwrap();
    // The vehicle turns round at its last point.
    let last = "{ x_m = 12.60, y_m = 4.32 }";
    let round = path.replace(last, "{ x_m = 12.60, y_m = 4.32, corner_radius_m = 0.0 }");
    assert_ne!(round, path);
    let first = path.lines().next().unwrap();
    for (name, path) in [
        ("round.toml", format!("{round}\n").repeat(100)),
        ("standing.toml", format!("{first}\n")),
    ] {
        let world = format!("{before}waypoints = [\n{path}]\n{after}");
        fs::write(folder.join(name), world).unwrap();
    }
}

struct Measured {
    kind: &'static str,
    process: Running,
    /// Its memory has settled by then.
    settled: Monotonic,
    /// Hours and megabytes.
    memory: Vec<[f64; 2]>,
    /// Processor time before the measurement.
    before_s: f64,
}

impl Measured {
    fn new(kind: &'static str, process: Running, settled: Monotonic) -> Self {
        Self {
            kind,
            process,
            settled,
            memory: Vec::new(),
            before_s: 0.0,
        }
    }

    fn processor_s(&self) -> f64 {
        self.process.processor_s() - self.before_s
    }

    fn sample(&mut self, now: Monotonic) {
        if now >= self.settled {
            let hours = now.since(self.settled).as_secs_f64() / 3600.0;
            let megabytes = self.process.memory() as f64 * 1e-6;
            self.memory.push([hours, megabytes]);
        }
    }

    /// Growth of its memory by least squares, megabytes an hour.
    fn growth(&self) -> f64 {
        let count = self.memory.len() as f64;
        let sum = |of: &dyn Fn([f64; 2]) -> f64| self.memory.iter().copied().map(of).sum::<f64>();
        let [hour, megabytes] = [0, 1].map(|n: usize| sum(&|sample| sample[n]) / count);
        let both = sum(&|sample| (sample[0] - hour) * (sample[1] - megabytes));
        both / sum(&|sample| (sample[0] - hour).powi(2))
    }
}

/// One row of the table for each kind of process; `length` is the time of measuring.
fn print_rows(all: &[Measured], length: Duration) {
    println!(
        "| process | count | % of a core, each | most | in all | memory, MB | growth, most, MB/h |"
    );
    for of_kind in all.chunk_by(|a, b| a.kind == b.kind) {
        let count = of_kind.len() as f64;
        let percent = 100.0 / length.as_secs_f64();
        let loads = of_kind
            .iter()
            .map(|process| percent * process.processor_s());
        let loads: Vec<f64> = loads.collect();
        let load: f64 = loads.iter().sum();
        let memory = of_kind
            .iter()
            .map(|process| process.memory.last().unwrap()[1]);
        let growth = of_kind.iter().map(Measured::growth);
        println!(
            "| {} | {count} | {:.2} | {:.2} | {load:.1} | {:.1} | {:.2} |",
            of_kind[0].kind,
            load / count,
            loads.iter().copied().fold(0.0, f64::max),
            memory.sum::<f64>() / count,
            growth.fold(f64::MIN, f64::max)
        );
    }
}

/// Presses and releases a key; takes the lease again where it is lost.
fn drive(mut operator: Operator, until: Monotonic) -> Journal {
    let is_over = || clock::now() >= until;
    while !is_over() {
        operator.start_driving(PRESSED.0);
        let name = operator.name.clone();
        let holds = |operator: &Operator| {
            let holder = operator.teleop().and_then(|teleop| teleop.lease.holder);
            holder.as_ref() == Some(&name)
        };
        while !is_over() && holds(&operator) {
            operator.hold(LET_GO.0, LET_GO.1);
            operator.hold(PRESSED.0, PRESSED.1);
        }
    }
    operator.journal
}

/// Garbage in the name of an operator, and where their role may not write.
fn flood(session: &Session, until: Monotonic) {
    let garbage = SeededRng::new(5).bytes(170);
    while clock::now() < until {
        for key in ["op/bert/drive", "status"] {
            for _ in 0..FLOOD_AT_ONCE / 2 {
                let put = session.put(format!("foreshore/{}/{key}", name(0)), garbage.clone());
                // Fails while there is no router.
                drop(put.congestion_control(CongestionControl::Drop).wait());
            }
        }
        sleep(Duration::from_millis(20));
    }
}

/// Numbers in what a console prints, by the words around them.
fn numbers(printed: &str, before: &str, after: &str) -> Vec<f64> {
    let found = printed.lines().filter_map(|line| {
        let (number, _) = line.split_once(before)?.1.split_once(after)?;
        number.parse().ok()
    });
    found.collect()
}

#[test]
#[ignore = "half an hour: measures"]
fn fifty_vehicles_behind_one_router_in_release() {
    let minutes = std::env::var("FORESHORE_FLEET_MINUTES");
    let minutes = minutes.map_or(25, |minutes| minutes.parse().unwrap());
    let length = Duration::from_mins(minutes);
    // As the shipped unit runs a vehicle: driving and the network at -10, mapping at 0.
    nice(-10).unwrap();
    let robots = (0..VEHICLES).map(|n| format!("--robot {}", name(n)));
    let fleet = Fleet::with(&robots.collect::<Vec<_>>().join(" "));
    let folder = fleet.scratch("run");
    fs::create_dir(&folder).unwrap();
    write_worlds(&folder);
    let port = free_port();
    let config = fleet.router_config(port);
    let start_router = || zenohd(&["-c", &config.display().to_string()]);
    let Some(router) = start_router() else { return };
    // It starts once all others wait for it, so that they connect at once.
    drop(router);
    let began = clock::now() + STARTUP;
    let settled = began + length / 5;
    let mut all = Vec::new();
    let at_vehicle = |n: usize, end: &str| folder.join(name(n) + end);
    for n in 0..VEHICLES {
        if n == 2 {
            // The others and the consoles would have machines of their own.
            nice(10).unwrap();
        }
        let (kind, world) = if n < DRIVING {
            ("driving", "round.toml")
        } else {
            ("standing", "standing.toml")
        };
        let mut line = format!(
            "robot-edge simulate {}/{world} --rate 1 --seed {n} --duration {} --keep-serving --quiet --robot {} --connect {} \
             --keys {}/vehicles/{2} --export {} --summary {}",
            folder.display(),
            (began.since(clock::now()) + length).as_secs(),
            name(n),
            quic(port),
            fleet.root().display(),
            at_vehicle(n, "").display(),
            at_vehicle(n, ".json").display()
        );
        if n < 2 {
            write!(line, " --drive-log {}", at_vehicle(n, ".csv").display()).unwrap();
        }
        all.push(Measured::new(kind, start(&line), settled));
        // This machine has two processors for all of them, and a vehicle ends where its drive loop stands for a second.
        sleep(Duration::from_millis(500));
    }
    let mut consoles_began = Vec::new();
    for n in 0..CONSOLES {
        let console = start(&format!(
            "operator-console --headless --for {} --robot {} {} --export {}",
            2 * (STARTUP + length).as_secs(),
            name(n),
            fleet.console("tv", &quic(port)),
            at_vehicle(n, "-console").display()
        ));
        all.push(Measured::new("console", console, settled));
        consoles_began.push(clock::now());
    }
    nice(-10).unwrap();
    let before_s: f64 = all.iter().map(Measured::processor_s).sum();
    all.insert(0, Measured::new("router", start_router().unwrap(), settled));
    sleep_until(began, || false);
    let startup_s: f64 = all.iter().map(Measured::processor_s).sum();
    println!(
        "from the start of the router on: {:.1} s of processor time, the router {:.2} s",
        startup_s - before_s,
        all[0].processor_s()
    );

    // Before the data ends.
    let until = began + length.saturating_sub(Duration::from_secs(20));
    let relay = UdpRelay::start(0, ([127, 0, 0, 1], port).into(), 1).unwrap();
    relay.set_both(shaped(0.02));
    let people = [("anna", port), ("sam", relay.address().port())];
    let drivers = [0, 1].map(|n| {
        let (person, port) = people[n];
        let keys = fleet.person(person);
        thread::spawn(move || drive(Operator::with_keys(&quic(port), &name(n), &keys), until))
    });
    let bert = Credentials::open(&fleet.person("bert")).unwrap();
    let bert = connected(&quic(port), Some(bert));
    let flooding = thread::spawn(move || flood(&bert, until));

    let (mut is_settled, mut killed) = (false, None);
    while clock::now() < until {
        let slow = &all.last().unwrap().process;
        slow.signal("STOP");
        sleep(Duration::from_secs(3));
        slow.signal("CONT");
        sleep(Duration::from_secs(1));
        let now = clock::now();
        if !is_settled && now >= settled {
            is_settled = true;
            for process in &mut all {
                process.before_s = process.process.processor_s();
            }
        }
        if killed.is_none() && now >= began + length / 2 {
            killed = Some(now);
            let Measured { process, .. } = &all[0];
            let (growth, before_s) = (all[0].growth(), -all[0].processor_s());
            println!("memory of the first router grows by {growth:.2} MB/h");
            process.signal("KILL");
            let router = start_router().unwrap();
            all[0] = Measured::new("router", router, now + length / 5);
            all[0].before_s = before_s;
        }
        for process in &mut all {
            process.sample(now);
        }
    }
    print_rows(&all, clock::elapsed(settled));
    flooding.join().unwrap();
    let mut problems = Vec::new();
    for (n, driver) in drivers.into_iter().enumerate() {
        let journal = driver.join().unwrap();
        let log = DriveLog::parse(&text(at_vehicle(n, ".csv"))).unwrap();
        evaluate(&log, &[&journal], &LIMITS).assert_no_faults();
        let (times, without_effect) = latencies(people[n].0, &log, &journal);
        // While the router is down, and until its loss is noticed.
        if without_effect > 15 {
            problems.push(format!(
                "vehicle {n}: {without_effect} presses without effect"
            ));
        }
        let p99 = at(&times, 0.99);
        if p99 > Duration::from_millis([10, 115][n]) {
            problems.push(format!("vehicle {n}: {p99:?} from a key to the motors"));
        }
    }

    let growths: Vec<f64> = all.iter().map(Measured::growth).collect();
    let mut processes: Vec<Running> = all.into_iter().map(|measured| measured.process).collect();
    let consoles = processes.split_off(1 + VEHICLES);
    for (n, console) in consoles.into_iter().enumerate() {
        let printed = console.ends_well();
        let kill_s = killed.unwrap().since(consoles_began[n]).as_secs_f64();
        let from_s = numbers(&printed, " s old, from ", " s to ");
        let until_s = numbers(&printed, " s to ", " s after the start");
        let since_kill = |(from_s, until_s): (f64, f64)| [from_s - kill_s, until_s - kill_s];
        let stale: Vec<_> = from_s.into_iter().zip(until_s).map(since_kill).collect();
        let synchronized_ms = numbers(&printed, "synchronized: ", " ms after");
        let bytes = numbers(&printed, " messages of ", " bytes");
        println!(
            "console {n}: synchronized {synchronized_ms:?} ms, stale {stale:.1?} s after the kill, {bytes:?} bytes"
        );
        let refused = printed.lines().filter(|line| line.starts_with("refused: "));
        problems.extend(refused.map(|refused| format!("console {n}: {refused}")));
        let is_slow = n + 1 == CONSOLES;
        // Once, while there is no router and until all are back.
        let is_promised = |[from_s, until_s]: &[f64; 2]| *from_s >= 0.0 && *until_s <= 10.0;
        if !is_slow && (stale.len() > 1 || !stale.iter().all(is_promised)) {
            problems.push(format!(
                "console {n}: old from and until {stale:.1?} s after the kill"
            ));
        }
    }
    for (n, edge) in processes.drain(1..).enumerate() {
        edge.interrupt();
        let summary: Value = serde_json::from_str(&text(at_vehicle(n, ".json"))).unwrap();
        assert_eq!(summary["scans"]["dropped"], json!({}), "vehicle {n}");
        assert_eq!(summary["losses"], json!({}), "vehicle {n}");
        if n < CONSOLES {
            assert_same_maps(&at_vehicle(n, ""), &at_vehicle(n, "-console"));
        }
    }
    let growth = growths.into_iter().fold(f64::MIN, f64::max);
    if growth >= 1.0 {
        problems.push(format!("memory grows by {growth} MB/h"));
    }
    assert!(problems.is_empty(), "{problems:#?}");
}
