//! What poses can be reckoned from: angles of joints, and attitudes.

use std::collections::BTreeSet;

use measurement::{ImuSample, StreamId};

/// Joints of one stream that are told apart, and bytes of the longest name that one may have.
const MAX_JOINTS: usize = 1000;
const MAX_NAME_BYTES: usize = 255;

/// The angles of one stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JointSurvey {
    /// Which stream.
    pub stream: StreamId,
    /// How many messages.
    pub count: u64,
    /// The joints whose angles it gives.
    pub names: BTreeSet<String>,
}

/// The attitudes of one stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttitudeSurvey {
    /// Which stream.
    pub stream: StreamId,
    /// How many messages.
    pub count: u64,
    /// How many of them give an orientation: raw ones give turn rates alone.
    pub oriented: u64,
}

impl JointSurvey {
    pub(super) const fn new(stream: StreamId) -> Self {
        Self {
            stream,
            count: 0,
            names: BTreeSet::new(),
        }
    }

    pub(super) fn add(&mut self, joints: &[(String, f64)]) {
        self.count += 1;
        for (name, _) in joints {
            let is_new = self.names.len() < MAX_JOINTS
                && name.len() <= MAX_NAME_BYTES
                && !self.names.contains(name);
            if is_new {
                self.names.insert(name.clone());
            }
        }
    }
}

impl AttitudeSurvey {
    pub(super) const fn new(stream: StreamId) -> Self {
        Self {
            stream,
            count: 0,
            oriented: 0,
        }
    }

    pub(super) fn add(&mut self, sample: &ImuSample) {
        self.count += 1;
        self.oriented += u64::from(sample.orientation_xyzw.is_some());
    }
}
