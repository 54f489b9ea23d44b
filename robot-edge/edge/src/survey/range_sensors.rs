//! Assigns the scan streams of a recording to the range sensors of a vehicle.

use std::fmt;

use super::{Survey, is_of_lidar};
use crate::config::RangeSensor;
use mapping::registered_scan::ScanKind;
use measurement::{Stream, StreamId};

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unassigned {
    NoScans,
    /// The configured topic has no scans.
    NoSuchStream {
        sensor: String,
        topic: String,
        /// The topics with scans.
        streams: Vec<String>,
    },
    /// Several streams could be the sensor's.
    SeveralStreams {
        sensor: String,
        streams: Vec<String>,
    },
    /// Streams could belong to several sensors.
    SeveralSensors {
        sensors: Vec<String>,
        streams: Vec<String>,
    },
}

impl fmt::Display for Unassigned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let first = |names: &[String]| names.first().cloned().unwrap_or_default();
        match self {
            Self::NoScans => write!(
                f,
                "there is no range sensor in it, so there is nothing to map"
            ),
            Self::NoSuchStream {
                sensor,
                topic,
                streams,
            } => {
                let have = match &streams[..] {
                    [] => "no scans at all".to_owned(),
                    streams => streams.join(", "),
                };
                write!(
                    f,
                    "no scans on {topic:?}, which `--topic {sensor}=` or the configuration names; it has {have}"
                )
            }
            Self::SeveralStreams { sensor, streams } => write!(
                f,
                "several topics carry scans: {}. Choose one, for example --topic {sensor}={}",
                streams.join(", "),
                first(streams)
            ),
            Self::SeveralSensors { sensors, streams } => write!(
                f,
                "scans on {} could be those of several sensors: {}. Say whose they are, for example --topic \
                 {}={}",
                streams.join(", "),
                sensors.join(", "),
                first(sensors),
                first(streams)
            ),
        }
    }
}

/// Assigns scan streams by name. For each of `sensors`: the index of the stream on its topic, or of the only stream
/// that no other sensor names. `None` for a sensor without scans, if another sensor has some and no stream is left
/// over.
fn assign(sensors: &[RangeSensor<'_>], streams: &[&str]) -> Result<Vec<Option<usize>>, Unassigned> {
    let stream_of = |topic: &str| streams.iter().position(|&name| name == topic);
    let mut assigned: Vec<Option<usize>> = sensors
        .iter()
        .map(|sensor| sensor.config.topic.as_deref().and_then(stream_of))
        .collect();
    let is_left = |stream: &usize| !assigned.contains(&Some(*stream));
    let left: Vec<usize> = (0..streams.len()).filter(is_left).collect();
    let unnamed: Vec<usize> = (0..sensors.len())
        .filter(|&sensor| sensors[sensor].config.topic.is_none())
        .collect();
    let names = |of: &[usize]| {
        of.iter()
            .map(|&stream| streams[stream].to_owned())
            .collect()
    };
    match (&unnamed[..], &left[..]) {
        (&[sensor], &[stream]) => assigned[sensor] = Some(stream),
        ([], _) | (_, []) => {}
        (&[sensor], several) => {
            return Err(Unassigned::SeveralStreams {
                sensor: sensors[sensor].name.to_owned(),
                streams: names(several),
            });
        }
        (several, left) => {
            let sensors = several
                .iter()
                .map(|&sensor| sensors[sensor].name.to_owned());
            return Err(Unassigned::SeveralSensors {
                sensors: sensors.collect(),
                streams: names(left),
            });
        }
    }
    let has_scans = assigned.iter().any(Option::is_some);
    let are_nobodys = (0..streams.len()).any(|stream| !assigned.contains(&Some(stream)));
    let missing = sensors.iter().zip(&assigned).find_map(|(sensor, stream)| {
        let topic = sensor.config.topic.as_ref().filter(|_| stream.is_none())?;
        Some((sensor.name, topic))
    });
    match missing {
        Some((sensor, topic)) if are_nobodys || !has_scans => Err(Unassigned::NoSuchStream {
            sensor: sensor.to_owned(),
            topic: topic.clone(),
            streams: streams.iter().map(|&name| name.to_owned()).collect(),
        }),
        Some(_) | None if has_scans => Ok(assigned),
        Some(_) | None => Err(Unassigned::NoScans),
    }
}

/// The stream of a lidar, an ultrasonic sensor or a bumper, as its topic and type name it; `None` for one that sweeps.
pub fn expected_stream(sensor: &RangeSensor<'_>) -> Option<Stream> {
    Some(Stream {
        name: sensor.config.topic.clone()?,
        type_name: expected_type(sensor)?.to_owned(),
    })
}

const fn expected_type(sensor: &RangeSensor<'_>) -> Option<&'static str> {
    Some(match sensor.config.scan_kind {
        ScanKind::Beams => return None,
        ScanKind::Cloud => "sensor_msgs/PointCloud2",
        ScanKind::Arc => "sensor_msgs/Range",
        ScanKind::Contact { .. } => "std_msgs/Bool",
    })
}

/// The stream of each of `sensors` among `streams`, which are numbered as they are; those that sweep share `scans` as
/// `assign` does.
pub fn assign_streams<'a>(
    sensors: &[RangeSensor<'_>],
    streams: impl Iterator<Item = &'a Stream> + Clone,
    scans: &[StreamId],
) -> Result<Vec<Option<StreamId>>, Unassigned> {
    let numbered = (0..=u16::MAX).map(StreamId).zip(streams);
    let name = |scan: &StreamId| {
        let mut streams = numbered.clone();
        let found = streams.find(|(id, _)| id == scan);
        found.map_or("", |(_, stream)| stream.name.as_str())
    };
    let names: Vec<_> = scans.iter().map(name).collect();
    let sweeps = |sensor: &RangeSensor<'_>| sensor.config.scan_kind == ScanKind::Beams;
    let is_cloud = |sensor: &RangeSensor<'_>| sensor.config.scan_kind == ScanKind::Cloud;
    let sweeping: Vec<_> = sensors.iter().copied().filter(sweeps).collect();
    let mut of_sweeping = if sweeping.is_empty() && sensors.iter().any(is_cloud) {
        Vec::new().into_iter()
    } else {
        assign(&sweeping, &names)?.into_iter()
    };
    let stream = |sensor: &RangeSensor<'_>| {
        if sweeps(sensor) {
            let scan = of_sweeping.next().flatten();
            return Ok(scan.and_then(|scan| scans.get(scan).copied()));
        }
        let is_its = |stream: &Stream| {
            let topic = sensor.config.topic.as_ref();
            topic.is_none_or(|topic| stream.name == *topic)
                && match sensor.config.scan_kind {
                    ScanKind::Cloud => is_of_lidar(&stream.type_name),
                    _ => expected_type(sensor) == Some(&stream.type_name),
                }
        };
        let of_type = numbered.clone().filter(|(_, stream)| is_its(stream));
        let of_type: Vec<_> = of_type.collect();
        if let [_, _, ..] = of_type[..] {
            let names = of_type.iter().map(|(_, stream)| stream.name.clone());
            return Err(Unassigned::SeveralStreams {
                sensor: sensor.name.to_owned(),
                streams: names.collect(),
            });
        }
        Ok(of_type.first().map(|(id, _)| *id))
    };
    let assigned = sensors.iter().map(stream).collect::<Result<Vec<_>, _>>()?;
    if assigned.iter().all(Option::is_none) {
        return Err(Unassigned::NoScans);
    }
    Ok(assigned)
}

impl Survey {
    /// [`assign_streams`] of the recording.
    pub fn assign(&self, sensors: &[RangeSensor<'_>]) -> Result<Vec<Option<StreamId>>, Unassigned> {
        let scans: Vec<_> = self.scans.iter().map(|(stream, _)| *stream).collect();
        let streams = self.streams.iter().map(|summary| &summary.stream);
        assign_streams(sensors, streams, &scans)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::RangeSensorConfig;
    use mapping::octree::RangeSensorModel;
    use mapping::registered_scan::SensorId;

    fn assigned(sensors: &[(&str, &str)], streams: &[&str]) -> Result<Vec<Option<usize>>, String> {
        let config = |(_, topic): &(&str, &str)| RangeSensorConfig {
            topic: (!topic.is_empty()).then(|| (*topic).to_owned()),
            ..RangeSensorConfig::default()
        };
        let configs: Vec<_> = sensors.iter().map(config).collect();
        let sensors = sensors.iter().zip(&configs);
        let sensors = sensors.map(|(&(name, _), config)| RangeSensor {
            id: SensorId(0),
            name,
            config,
            model: RangeSensorModel::default(),
        });
        let sensors: Vec<_> = sensors.collect();
        assign(&sensors, streams).map_err(|error| error.to_string())
    }

    #[test]
    fn topics_come_first_and_the_sensor_without_one_gets_what_is_left() {
        let boat = [("laser", ""), ("sonar", "/sonar")];
        assert_eq!(
            assigned(&boat, &["/sonar", "/scan"]),
            Ok(vec![Some(1), Some(0)])
        );
        assert_eq!(assigned(&boat, &["/sonar"]), Ok(vec![None, Some(0)]));
        assert_eq!(assigned(&[("laser", "")], &["/any"]), Ok(vec![Some(0)]));
        // Other streams are ignored if every sensor has its own.
        assert_eq!(
            assigned(&[("laser", "/b")], &["/a", "/b"]),
            Ok(vec![Some(1)])
        );
    }

    #[test]
    fn a_sensor_that_was_not_recorded_is_missed_only_where_another_stream_could_be_its_own() {
        let boat = [("laser", "/scan"), ("sonar", "/sonar")];
        assert_eq!(assigned(&boat, &["/scan"]), Ok(vec![Some(0), None]));
        assert_eq!(
            assigned(&boat, &["/scan", "/deltat"]).unwrap_err(),
            "no scans on \"/sonar\", which `--topic sonar=` or the configuration names; it has /scan, /deltat"
        );
    }

    #[test]
    fn what_is_open_lists_the_candidates() {
        let error =
            |sensors: &[(&str, &str)], streams: &[&str]| assigned(sensors, streams).unwrap_err();
        assert_eq!(
            error(
                &[("laser", ""), ("sonar", "/sonar")],
                &["/a", "/sonar", "/b"]
            ),
            "several topics carry scans: /a, /b. Choose one, for example --topic laser=/a"
        );
        assert_eq!(
            error(&[("front", ""), ("rear", "")], &["/scan"]),
            "scans on /scan could be those of several sensors: front, rear. Say whose they are, for example \
             --topic front=/scan"
        );
        assert_eq!(
            error(&[("laser", "")], &[]),
            "there is no range sensor in it, so there is nothing to map"
        );
        assert!(error(&[("laser", "/scan")], &[]).ends_with("it has no scans at all"));
    }
}
