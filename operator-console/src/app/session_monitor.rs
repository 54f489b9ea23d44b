//! What the console observes, noted once each: changes of link and run, end of data, collision monitor.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::Status;
use protocol::tile::BootId;

use crate::event_log::Severity;
use crate::link::Transport;
use crate::model::{ConsoleModel, LinkState};
use crate::panels::driving::is_stopped_by_monitor;
use crate::panels::formatting::age;

#[derive(Clone, Debug, Default)]
pub(super) struct SessionMonitor {
    link: Option<LinkState>,
    /// When silence was detected, and how long it lasted by then.
    lost: Option<(Monotonic, Duration)>,
    run: Option<BootId>,
    transport: Option<Transport>,
    has_ended: bool,
    /// Since when the collision monitor stops a driven vehicle, and whether that was logged.
    held: Option<(Monotonic, bool)>,
}

/// Shorter stops are not logged: the collision monitor decides again with every scan.
const HELD_FOR: Duration = Duration::from_secs(1);

const MAP_RESTARTS: &str = "its map is received again";

pub(super) type LogNote = (Severity, &'static str, String);

impl SessionMonitor {
    pub(super) fn update(
        &mut self,
        model: &ConsoleModel,
        transport: Option<Transport>,
        now: Monotonic,
    ) -> Vec<LogNote> {
        let mut notes = Vec::new();
        let robot = model.robot();
        let link = model.connection().state(now);
        let had_ended = std::mem::replace(&mut self.has_ended, model.reports_ended());
        let mut has_restarted = self.has_restarted(model.run());
        if self.link != Some(link) {
            match link {
                LinkState::Waiting => {}
                LinkState::Live => {
                    let text = match self.lost.take() {
                        Some((seen, silent)) => {
                            let silent = age(silent + now.since(seen));
                            let anew = if std::mem::take(&mut has_restarted) {
                                format!(", restarted: {MAP_RESTARTS}")
                            } else {
                                String::new()
                            };
                            format!("{robot} is connected again after {silent}{anew}")
                        }
                        None => format!("{robot} is connected"),
                    };
                    notes.push((Severity::Info, "link", text));
                }
                LinkState::Silent => {
                    let silent = model.connection().age(now).unwrap_or_default();
                    self.lost = Some((now, silent));
                    let gone = format!("no data from {robot}");
                    notes.push(if model.is_silence_expected() {
                        let text = format!("{gone} (its data had ended)");
                        (Severity::Info, "link", text)
                    } else {
                        let text = format!("{gone}, for {}", age(silent));
                        (Severity::Warning, "link", text)
                    });
                }
            }
            self.link = Some(link);
        }
        if has_restarted {
            let text = format!("{robot} has restarted: {MAP_RESTARTS}");
            notes.push((Severity::Info, "link", text));
        }
        if self.has_ended && !had_ended {
            let text = format!("{robot}'s data has ended");
            notes.push((Severity::Info, "data", text));
        }
        let is_heard = link == LinkState::Live && !model.awaits_status();
        if self.is_newly_held(model, is_heard) {
            let text = format!("{robot} is limited by the collision monitor");
            notes.push((Severity::Info, "collision monitor", text));
        }
        if transport.is_some() && self.transport != transport {
            self.transport = transport;
            notes.extend(transport.and_then(transport_note));
        }
        notes
    }

    fn is_newly_held(&mut self, model: &ConsoleModel, is_heard: bool) -> bool {
        let is_held = |status: &Status| status.teleop.as_ref().is_some_and(is_stopped_by_monitor);
        let latest = model.status().filter(|_| is_heard);
        let Some((_, latest)) = latest.filter(|(status, _)| is_held(status)) else {
            self.held = None;
            return false;
        };
        let (since, is_noted) = self.held.get_or_insert((*latest, false));
        let is_anew = !*is_noted && latest.since(*since) >= HELD_FOR;
        *is_noted |= is_anew;
        is_anew
    }

    fn has_restarted(&mut self, run: Option<BootId>) -> bool {
        let Some(run) = run else {
            return false;
        };
        let before = self.run.replace(run);
        before.is_some_and(|before| before != run)
    }
}

fn transport_note(transport: Transport) -> Option<LogNote> {
    let (severity, text) = match transport {
        Transport::Quic => (Severity::Info, "Connected by QUIC"),
        Transport::Tls => (Severity::Info, "Connected by TLS"),
        Transport::Tcp => (Severity::Info, "Connected by TCP, not secured"),
        Transport::TlsInstead => (
            Severity::Warning,
            "QUIC does not answer: control goes by TLS, where what is lost holds up what follows",
        ),
        Transport::Other => return None,
    };
    Some((severity, "link", text.to_owned()))
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{Clamp, TeleopState};

    use super::*;
    use crate::test_support::{announce_boot, at, idle_teleop_status, inject, scout, status_of};

    #[test]
    fn link_changes_are_logged_once() {
        let mut model = scout();
        let mut monitor = SessionMonitor::default();
        let mut update = |model: &ConsoleModel, transport, ms| -> Vec<String> {
            let notes = monitor.update(model, transport, at(ms));
            notes.into_iter().map(|(_, _, text)| text).collect()
        };
        assert_eq!(update(&model, None, 0), [""; 0]);
        inject(&mut model, Topic::Status, &Status::default(), at(1_000));
        assert_eq!(update(&model, None, 1_000), ["scout is connected"]);
        let [latest] = &update(&model, Some(Transport::TlsInstead), 1_100)[..] else {
            panic!();
        };
        assert!(latest.starts_with("QUIC does not answer"), "{latest}");
        assert_eq!(update(&model, None, 1_200), [""; 0]);
        assert_eq!(update(&model, Some(Transport::TlsInstead), 1_300), [""; 0]);
        let lost = update(&model, None, 3_000);
        assert_eq!(lost, ["no data from scout, for 2.0 s"]);
        inject(&mut model, Topic::Status, &Status::default(), at(9_000));
        assert_eq!(
            update(&model, None, 9_000),
            ["scout is connected again after 8.0 s"]
        );
    }

    #[test]
    fn robot_restart_is_logged_once() {
        let mut model = scout();
        let mut monitor = SessionMonitor::default();
        let mut update = |ms, run: Option<u8>| -> Vec<String> {
            if let Some(run) = run {
                announce_boot(&mut model, BootId([run; 16]), at(ms));
            }
            let notes = monitor.update(&model, None, at(ms));
            notes.into_iter().map(|(_, _, text)| text).collect()
        };
        assert_eq!(update(1_000, Some(7)), ["scout is connected"]);
        let quick = "scout has restarted: its map is received again";
        assert_eq!(update(1_500, Some(8)), [quick]);
        assert_eq!(update(4_000, None).len(), 1);
        let again = "scout is connected again after 3.4 s, restarted: its map is received again";
        assert_eq!(update(4_900, Some(9)), [again]);
        assert_eq!(update(5_000, Some(9)), [""; 0]);
    }

    #[test]
    fn silence_after_end_of_data_is_no_warning() {
        for can_be_driven in [false, true] {
            let mut model = scout();
            let mut monitor = SessionMonitor::default();
            inject(&mut model, Topic::Status, &Status::default(), at(0));
            monitor.update(&model, None, at(0));
            let ended = Status {
                has_ended: true,
                teleop: can_be_driven.then(idle_teleop_status),
                ..Status::default()
            };
            inject(&mut model, Topic::Status, &ended, at(500));
            let end = (Severity::Info, "data", "scout's data has ended".to_owned());
            assert_eq!(monitor.update(&model, None, at(500)), [end]);
            assert_eq!(monitor.update(&model, None, at(600)), []);
            let latest = monitor.update(&model, None, at(2_500));
            let gone = "no data from scout (its data had ended)".to_owned();
            assert_eq!(latest, [(Severity::Info, "link", gone)]);
        }
    }

    /// The collision monitor permits the requested motion, m/s.
    fn is_let(model: &mut ConsoleModel, commanded_mps: f32, ms: u64) {
        let mut teleop = idle_teleop_status();
        teleop.state = TeleopState::Driving;
        teleop.clamp = Some(Clamp::CollisionMonitor);
        teleop.requested.linear_mps = 0.8;
        teleop.applied.linear_mps = commanded_mps;
        let status = status_of(teleop);
        inject(model, Topic::Status, &status, at(ms));
    }

    fn of_monitor(notes: Vec<LogNote>) -> Vec<LogNote> {
        let of_monitor = notes
            .into_iter()
            .filter(|(_, kind, _)| *kind == "collision monitor");
        of_monitor.collect()
    }

    #[test]
    fn held_vehicle_is_logged_once() {
        let mut model = scout();
        let mut monitor = SessionMonitor::default();
        let mut held = Vec::new();
        for (ms, commanded_mps) in [
            (0, 0.0),
            (900, 0.0),
            (950, 0.3),
            (1_000, 0.0),
            (1_500, 0.0),
            (2_000, 0.0),
            (5_000, 0.0),
            (5_100, 0.3),
            (5_200, 0.0),
            (6_200, 0.0),
        ] {
            is_let(&mut model, commanded_mps, ms);
            let notes = monitor.update(&model, None, at(ms));
            held.extend(of_monitor(notes).into_iter().map(|note| (ms, note)));
        }
        let text = "scout is limited by the collision monitor".to_owned();
        let noted = |ms| (ms, (Severity::Info, "collision monitor", text.clone()));
        assert_eq!(held, [noted(2_000), noted(6_200)]);
    }

    #[test]
    fn silent_vehicle_is_not_logged_as_held() {
        let mut model = scout();
        let mut monitor = SessionMonitor::default();
        let mut held = Vec::new();
        is_let(&mut model, 0.0, 0);
        for ms in [0, 300, 1_100, 5_000] {
            held.extend(of_monitor(monitor.update(&model, None, at(ms))));
        }
        // State from before the silence does not count.
        is_let(&mut model, 0.0, 5_100);
        for ms in [5_100, 5_300] {
            held.extend(of_monitor(monitor.update(&model, None, at(ms))));
        }
        assert_eq!(held, []);
    }
}
