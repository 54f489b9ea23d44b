//! What passes between the link and the model: plain data, as bytes came and as bytes go.

/// Numbers a question, so that its answers find their way back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestId(pub u64);

/// What the link tells the model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    /// A message on a key that is subscribed to.
    Sample {
        /// The key.
        key: String,
        /// The message.
        payload: Vec<u8>,
    },
    /// One of any number of replies to a question.
    Reply {
        /// Which question.
        request: RequestId,
        /// The key of the reply.
        key: String,
        /// The message.
        payload: Vec<u8>,
    },
    /// No more replies to this question will come: all came, or time ran out.
    Ended {
        /// Which question.
        request: RequestId,
    },
    /// Messages that the link could not hand over.
    Lost {
        /// Because the console did not keep up.
        overrun: u64,
        /// Because they were longer than any message.
        oversized: u64,
    },
    /// Whether the robot's presence is announced. For display only.
    Presence(bool),
}

/// Which sessions are open: without one, nothing is asked over it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenSessions {
    /// For what is small and must be early.
    pub control: bool,
    /// For maps.
    pub bulk: bool,
}

impl OpenSessions {
    /// As it is meant to be.
    pub const BOTH: Self = Self {
        control: true,
        bulk: true,
    };
    /// Nothing is open.
    pub const NONE: Self = Self {
        control: false,
        bulk: false,
    };
}

/// What the model asks the link to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outgoing {
    /// Ask a question.
    Get {
        /// Its number.
        request: RequestId,
        /// The key.
        key: String,
        /// The question itself; empty where the key says it all.
        payload: Vec<u8>,
        /// Whether it goes over the bulk session.
        is_bulk: bool,
    },
    /// Send a message over the control session.
    Put {
        /// The key.
        key: String,
        /// The message.
        payload: Vec<u8>,
    },
}
