//! Who comes and goes at a vehicle, in as few lines as tell it.
//!
//! A console that looks for robots connects every few seconds and is gone a second later, all day long. Of each
//! visitor the first link is told at once, and whatever lasts; of mere looks one line a minute says how many there
//! were, and when the last one ended. So neither the first nor the last is lost, and the log is not full of them.

use std::collections::BTreeMap;
use std::time::Duration;

use super::Line;
use crate::clock::Monotonic;

/// A link that has ended sooner than this was a look: consoles ask who is there within 2 s.
const LOOK: Duration = Duration::from_secs(3);
/// Looks are told of together, this often.
const PERIOD: Duration = Duration::from_mins(1);

/// A link that was set up, or has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkNews {
    /// Whose certificate was shown.
    pub who: String,
    /// What the link is for.
    pub channel: &'static str,
    /// Where the other end is: protocol, host and the port, which no other link has.
    pub from: String,
    /// Whether it was set up; else it has ended.
    pub is_up: bool,
}

/// Those who were here within the last minute.
#[derive(Debug, Default)]
pub(super) struct Visits(BTreeMap<Visitor, Visit>);

/// Somebody at some computer, for one thing.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Visitor {
    who: String,
    channel: &'static str,
    host: String,
}

#[derive(Debug)]
struct Visit {
    /// Looks are counted since then.
    since: Monotonic,
    /// Links that may last: nothing was told of them yet.
    fresh: Vec<Fresh>,
    looks: u64,
    /// How the last look ended: when, seconds since 1970, and where from.
    last: Option<(u64, String)>,
}

#[derive(Debug)]
struct Fresh {
    at: Monotonic,
    from: String,
    line: Line,
}

impl Visits {
    /// A link was set up or has ended at `now`, which is `at_s` seconds since 1970; the line to be written of it now.
    pub(super) fn hear(&mut self, link: LinkNews, at_s: u64, now: Monotonic) -> Option<Line> {
        let (kind, verb) = if link.is_up {
            ("connect", "connects")
        } else {
            ("disconnect", "is gone")
        };
        let LinkNews {
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
        let visitor = Visitor {
            host: host.to_owned(),
            who,
            channel,
        };
        let Some(visit) = self.0.get_mut(&visitor) else {
            if is_up {
                self.0.insert(visitor, Visit::begun(now));
            }
            return Some(line);
        };
        if is_up {
            visit.fresh.push(Fresh {
                at: now,
                from,
                line,
            });
            return None;
        }
        let Some(index) = visit.fresh.iter().position(|fresh| fresh.from == from) else {
            return Some(line);
        };
        visit.fresh.remove(index);
        visit.looks += 1;
        visit.last = Some((at_s, from));
        None
    }

    /// What is to be written as time passes, the oldest first.
    pub(super) fn due(&mut self, now: Monotonic) -> Vec<Line> {
        let mut lines = self.settle(|fresh| now.since(fresh.at) >= LOOK);
        self.0.retain(|visitor, visit| {
            if now.since(visit.since) < PERIOD {
                return true;
            }
            visit.since = now;
            let looks = visit.take_looks(visitor);
            let is_here = looks.is_some() || !visit.fresh.is_empty();
            lines.extend(looks);
            is_here
        });
        lines.sort_by_key(|line| line.at_s);
        lines
    }

    /// What is to be written before a line of something else: whoever does that has connected before.
    pub(super) fn before_others(&mut self) -> Vec<Line> {
        self.settle(|_fresh| true)
    }

    /// What is to be written where the log closes, the oldest first.
    pub(super) fn end(&mut self) -> Vec<Line> {
        let mut lines = self.before_others();
        let visits = self.0.iter_mut();
        lines.extend(visits.filter_map(|(visitor, visit)| visit.take_looks(visitor)));
        lines.sort_by_key(|line| line.at_s);
        lines
    }

    /// Tells of links that are no looks.
    fn settle(&mut self, is_settled: impl Fn(&Fresh) -> bool) -> Vec<Line> {
        let mut lines = Vec::new();
        for visit in self.0.values_mut() {
            let settled = visit.fresh.extract_if(.., |fresh| is_settled(fresh));
            lines.extend(settled.map(|fresh| fresh.line));
        }
        lines
    }
}

impl Visit {
    const fn begun(since: Monotonic) -> Self {
        Self {
            since,
            fresh: Vec::new(),
            looks: 0,
            last: None,
        }
    }

    /// The line that tells of all looks since the last one, where there were any.
    fn take_looks(&mut self, visitor: &Visitor) -> Option<Line> {
        let (at_s, from) = self.last.take()?;
        let Visitor { who, channel, .. } = visitor;
        let times = match std::mem::take(&mut self.looks) {
            1 => "once".to_owned(),
            n => format!("{n} times"),
        };
        Some(Line {
            at_s,
            kind: "looks",
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

    fn link(is_up: bool, port: u16) -> LinkNews {
        LinkNews {
            who: "operator:anna".to_owned(),
            channel: "control",
            from: format!("quic/10.0.0.5:{port}"),
            is_up,
        }
    }

    /// A minute's looks, one every 2 s, of which each takes a second; what is written meanwhile.
    fn looks(visits: &mut Visits, from_s: u64) -> Vec<(u64, String)> {
        let mut lines = Vec::new();
        for s in (from_s..from_s + 60).step_by(2) {
            let port = s as u16 + 1_000;
            for (is_up, s) in [(true, s), (false, s + 1)] {
                lines.extend(visits.due(at(s * 1_000)));
                lines.extend(visits.hear(link(is_up, port), s, at(s * 1_000)));
            }
        }
        told(lines)
    }

    fn told(lines: impl IntoIterator<Item = Line>) -> Vec<(u64, String)> {
        let lines = lines.into_iter();
        lines.map(|line| (line.at_s, line.message)).collect()
    }

    #[test]
    fn looks_are_told_once_a_minute_and_the_first_and_the_last_are_among_them() {
        let mut visits = Visits::default();
        let word = |s: u64, words: &str| (s, format!("operator:anna {words}"));
        assert_eq!(
            looks(&mut visits, 100),
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
            looks(&mut visits, 160),
            [word(159, &more("29 times", 1158))]
        );
        assert_eq!(told(visits.end()), [word(219, &more("30 times", 1218))]);
        assert_eq!(told(visits.end()), [], "told is told");
    }

    #[test]
    fn a_link_that_lasts_is_told_soon_and_so_is_its_end() {
        let mut visits = Visits::default();
        assert!(visits.hear(link(true, 1), 100, at(100_000)).is_some());
        assert!(visits.hear(link(false, 1), 101, at(101_000)).is_some());
        assert_eq!(visits.hear(link(true, 2), 102, at(102_000)), None);
        assert_eq!(visits.due(at(104_900)), []);
        let joined = (
            102,
            "operator:anna connects, control, from quic/10.0.0.5:2".to_owned(),
        );
        assert_eq!(told(visits.due(at(105_000))), [joined]);
        assert_eq!(visits.due(at(110_000)), [], "told is told");
        let gone = visits.hear(link(false, 2), 900, at(900_000)).unwrap();
        assert_eq!((gone.at_s, gone.kind), (900, "disconnect"));
    }

    #[test]
    fn who_does_something_else_has_connected_before() {
        let mut visits = Visits::default();
        assert!(visits.hear(link(true, 1), 100, at(100_000)).is_some());
        assert_eq!(visits.hear(link(true, 2), 101, at(101_000)), None);
        assert_eq!(told(visits.before_others()).len(), 1);
        let gone = visits.hear(link(false, 2), 102, at(102_000));
        assert!(gone.is_some(), "what was told to begin is told to end");
    }

    #[test]
    fn the_same_keys_at_another_computer_are_told_at_once() {
        let mut visits = Visits::default();
        assert!(visits.hear(link(true, 1), 100, at(100_000)).is_some());
        let elsewhere = LinkNews {
            from: "quic/10.0.0.6:1".to_owned(),
            ..link(true, 1)
        };
        assert!(visits.hear(elsewhere, 101, at(101_000)).is_some());
    }

    #[test]
    fn who_has_not_been_here_for_a_minute_is_new_again() {
        let mut visits = Visits::default();
        assert!(visits.hear(link(true, 1), 100, at(100_000)).is_some());
        assert!(visits.hear(link(false, 1), 101, at(101_000)).is_some());
        assert_eq!(visits.due(at(160_000)), []);
        assert!(visits.0.is_empty(), "nothing is kept of who is not here");
        assert!(visits.hear(link(true, 2), 161, at(161_000)).is_some());
    }
}
