//! Summarizes connections to a vehicle in few lines of the audit log.
//!
//! A console that looks for robots connects every few seconds and is gone a second later, all day long. Of each
//! visitor the first link is written at once, and so are links that last; of mere looks one line a minute says how many there
//! were, and when the last one ended. So neither the first nor the last is lost, and the log is not full of them.

use std::collections::BTreeMap;
use std::time::Duration;

use super::Line;
use measurement::time::Monotonic;

/// A link that has ended sooner than this was a look: consoles ask who is there within 2 s.
const SHORT_CONNECTION: Duration = Duration::from_secs(3);
/// Short connections are summed up this often.
const PERIOD: Duration = Duration::from_mins(1);

/// A link that was set up, or has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkEvent {
    /// Whose certificate was shown.
    pub who: String,
    pub channel: &'static str,
    /// Where the other end is: protocol, host and the port, which no other link has.
    pub from: String,
    /// Whether it was set up; else it has ended.
    pub is_up: bool,
}

/// The peers of the last minute.
#[derive(Debug, Default)]
pub(super) struct ConnectionSummary(BTreeMap<Peer, PeerConnections>);

/// Somebody at some computer, for one thing.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Peer {
    who: String,
    channel: &'static str,
    host: String,
}

#[derive(Debug)]
struct PeerConnections {
    /// Looks are counted since then.
    since: Monotonic,
    /// Links that may last: nothing was written of them yet.
    pending: Vec<PendingConnect>,
    short_connections: u64,
    /// How the last look ended: when, seconds since 1970, and where from.
    last: Option<(u64, String)>,
}

#[derive(Debug)]
struct PendingConnect {
    at: Monotonic,
    from: String,
    line: Line,
}

impl ConnectionSummary {
    /// A link was set up or has ended at `now`, which is `at_s` seconds since 1970; the line to be written of it now.
    pub(super) fn record(&mut self, link: LinkEvent, at_s: u64, now: Monotonic) -> Option<Line> {
        let (kind, verb) = if link.is_up {
            ("connect", "connects")
        } else {
            ("disconnect", "is gone")
        };
        let LinkEvent {
            who,
            channel,
            from,
            is_up,
        } = link;
        let line = Line {
            at_s,
            kind,
            what: None,
            message: format!("{who} {verb}, {channel}, from {from}"),
        };
        let host = from.rsplit_once(':').map_or(&*from, |(host, _port)| host);
        let peer = Peer {
            host: host.to_owned(),
            who,
            channel,
        };
        let Some(peer_connections) = self.0.get_mut(&peer) else {
            if is_up {
                self.0.insert(peer, PeerConnections::new(now));
            }
            return Some(line);
        };
        if is_up {
            peer_connections.pending.push(PendingConnect {
                at: now,
                from,
                line,
            });
            return None;
        }
        let Some(index) = peer_connections
            .pending
            .iter()
            .position(|pending| pending.from == from)
        else {
            return Some(line);
        };
        peer_connections.pending.remove(index);
        peer_connections.short_connections += 1;
        peer_connections.last = Some((at_s, from));
        None
    }

    /// What is to be written as time passes, the oldest first.
    pub(super) fn due(&mut self, now: Monotonic) -> Vec<Line> {
        let mut lines = self.drain_settled(|pending| now.since(pending.at) >= SHORT_CONNECTION);
        self.0.retain(|peer, peer_connections| {
            if now.since(peer_connections.since) < PERIOD {
                return true;
            }
            peer_connections.since = now;
            let short_connections = peer_connections.take_short_connections(peer);
            let is_here = short_connections.is_some() || !peer_connections.pending.is_empty();
            lines.extend(short_connections);
            is_here
        });
        lines.sort_by_key(|line| line.at_s);
        lines
    }

    /// What is to be written before a line of something else: its author has connected before.
    pub(super) fn flush_pending(&mut self) -> Vec<Line> {
        self.drain_settled(|_fresh| true)
    }

    /// What is to be written where the log closes, the oldest first.
    pub(super) fn end(&mut self) -> Vec<Line> {
        let mut lines = self.flush_pending();
        let connections = self.0.iter_mut();
        lines.extend(
            connections.filter_map(|(peer, peer_connections)| {
                peer_connections.take_short_connections(peer)
            }),
        );
        lines.sort_by_key(|line| line.at_s);
        lines
    }

    /// Tells of links that are no looks.
    fn drain_settled(&mut self, is_settled: impl Fn(&PendingConnect) -> bool) -> Vec<Line> {
        let mut lines = Vec::new();
        for peer_connections in self.0.values_mut() {
            let settled = peer_connections
                .pending
                .extract_if(.., |pending| is_settled(pending));
            lines.extend(settled.map(|pending| pending.line));
        }
        lines
    }
}

impl PeerConnections {
    const fn new(since: Monotonic) -> Self {
        Self {
            since,
            pending: Vec::new(),
            short_connections: 0,
            last: None,
        }
    }

    /// The line that sums up all short connections since the last one, if there were any.
    fn take_short_connections(&mut self, peer: &Peer) -> Option<Line> {
        let (at_s, from) = self.last.take()?;
        let Peer { who, channel, .. } = peer;
        let times = match std::mem::take(&mut self.short_connections) {
            1 => "once".to_owned(),
            n => format!("{n} times"),
        };
        Some(Line {
            at_s,
            kind: "short_connections",
            what: None,
            message: format!(
                "{who} connected and was soon gone {times} more, {channel}, last from {from}"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    fn link(is_up: bool, port: u16) -> LinkEvent {
        LinkEvent {
            who: "operator:anna".to_owned(),
            channel: "control",
            from: format!("quic/10.0.0.5:{port}"),
            is_up,
        }
    }

    /// A minute's looks, one every 2 s, of which each takes a second; what is written meanwhile.
    fn short_connections(connections: &mut ConnectionSummary, from_s: u64) -> Vec<(u64, String)> {
        let mut lines = Vec::new();
        for s in (from_s..from_s + 60).step_by(2) {
            let port = s as u16 + 1_000;
            for (is_up, s) in [(true, s), (false, s + 1)] {
                lines.extend(connections.due(at(s * 1_000)));
                lines.extend(connections.record(link(is_up, port), s, at(s * 1_000)));
            }
        }
        self::lines(lines)
    }

    fn lines(lines: impl IntoIterator<Item = Line>) -> Vec<(u64, String)> {
        let lines = lines.into_iter();
        lines.map(|line| (line.at_s, line.message)).collect()
    }

    #[test]
    fn short_links_are_logged_once_a_minute() {
        let mut connections = ConnectionSummary::default();
        let word = |s: u64, words: &str| (s, format!("operator:anna {words}"));
        assert_eq!(
            short_connections(&mut connections, 100),
            [
                word(100, "connects, control, from quic/10.0.0.5:1100"),
                word(101, "is gone, control, from quic/10.0.0.5:1100"),
            ]
        );
        let more = |times: &str, port: u16| {
            format!(
                "connected and was soon gone {times} more, control, last from quic/10.0.0.5:{port}"
            )
        };
        assert_eq!(
            short_connections(&mut connections, 160),
            [word(159, &more("29 times", 1158))]
        );
        assert_eq!(
            lines(connections.end()),
            [word(219, &more("30 times", 1218))]
        );
        assert_eq!(lines(connections.end()), [], "each line is written once");
    }

    #[test]
    fn a_link_that_lasts_is_written_soon_and_so_is_its_end() {
        let mut connections = ConnectionSummary::default();
        assert!(
            connections
                .record(link(true, 1), 100, at(100_000))
                .is_some()
        );
        assert!(
            connections
                .record(link(false, 1), 101, at(101_000))
                .is_some()
        );
        assert_eq!(connections.record(link(true, 2), 102, at(102_000)), None);
        assert_eq!(connections.due(at(104_900)), []);
        let joined = (
            102,
            "operator:anna connects, control, from quic/10.0.0.5:2".to_owned(),
        );
        assert_eq!(lines(connections.due(at(105_000))), [joined]);
        assert_eq!(
            connections.due(at(110_000)),
            [],
            "each line is written once"
        );
        let gone = connections
            .record(link(false, 2), 900, at(900_000))
            .unwrap();
        assert_eq!((gone.at_s, gone.kind), (900, "disconnect"));
    }

    #[test]
    fn who_does_something_else_has_connected_before() {
        let mut connections = ConnectionSummary::default();
        assert!(
            connections
                .record(link(true, 1), 100, at(100_000))
                .is_some()
        );
        assert_eq!(connections.record(link(true, 2), 101, at(101_000)), None);
        assert_eq!(lines(connections.flush_pending()).len(), 1);
        let gone = connections.record(link(false, 2), 102, at(102_000));
        assert!(gone.is_some(), "a beginning that was written has an end");
    }

    #[test]
    fn the_same_keys_at_another_computer_are_written_at_once() {
        let mut connections = ConnectionSummary::default();
        assert!(
            connections
                .record(link(true, 1), 100, at(100_000))
                .is_some()
        );
        let elsewhere = LinkEvent {
            from: "quic/10.0.0.6:1".to_owned(),
            ..link(true, 1)
        };
        assert!(connections.record(elsewhere, 101, at(101_000)).is_some());
    }

    #[test]
    fn who_has_not_been_here_for_a_minute_is_new_again() {
        let mut connections = ConnectionSummary::default();
        assert!(
            connections
                .record(link(true, 1), 100, at(100_000))
                .is_some()
        );
        assert!(
            connections
                .record(link(false, 1), 101, at(101_000))
                .is_some()
        );
        assert_eq!(connections.due(at(160_000)), []);
        assert!(
            connections.0.is_empty(),
            "nothing is kept of who is not here"
        );
        assert!(
            connections
                .record(link(true, 2), 161, at(161_000))
                .is_some()
        );
    }
}
