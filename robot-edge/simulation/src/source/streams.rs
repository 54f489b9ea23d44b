//! The streams of a run.

use measurement::{Stream, StreamId};

/// Streams that every run has, in the order of their [`StreamId`]s.
const ALWAYS: [(&str, &str); 3] = [
    ("/tf_static", "tf2_msgs/TFMessage"),
    ("/tf", "tf2_msgs/TFMessage"),
    ("/odom", "nav_msgs/Odometry"),
];
pub(super) const TF_STATIC: StreamId = StreamId(0);
pub(super) const TF: StreamId = StreamId(1);
pub(super) const ODOM: StreamId = StreamId(2);
/// That of the main laser, which comes next.
#[cfg(test)]
pub(super) const SCAN: StreamId = StreamId(3);

/// Streams by name; a [`StreamId`] is an index into them.
pub(super) struct Streams(Vec<Stream>);

impl Streams {
    /// Those that every run has.
    pub(super) fn new() -> Self {
        let mut streams = Self(Vec::new());
        for (name, type_name) in ALWAYS {
            streams.called(name, type_name);
        }
        streams
    }

    /// The stream of this name, which several sensors may share.
    pub(super) fn called(&mut self, name: &str, type_name: &str) -> StreamId {
        let known = self.0.iter().position(|stream| stream.name == name);
        let index = known.unwrap_or_else(|| {
            self.0.push(Stream {
                name: name.to_owned(),
                type_name: type_name.to_owned(),
            });
            self.0.len() - 1
        });
        StreamId(index as u16)
    }

    pub(super) fn into_vec(self) -> Vec<Stream> {
        self.0
    }
}
