//! What the operator asks of the program. Panels and map only say what is wanted; the app does it.

use protocol::layer::{LayerId, Scheme};

use crate::helm::Intent;
use crate::link::FoundRobot;

/// A wish of the operator.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Show this robot instead of any other.
    Connect(FoundRobot),
    /// Ask this address for robots, too. It is a control endpoint.
    AddAddress(String),
    /// Show another layer.
    ShowLayer(LayerId),
    /// Show the layer in other colours.
    ShowScheme(Scheme),
    /// Spread the colours over the values of the map.
    FitColors,
    /// Look elsewhere.
    Look(Look),
    /// Something about driving.
    Drive(Intent),
}

/// How to look at the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Keep the whole map in sight.
    Whole,
    /// Keep the vehicle in the middle, or no longer.
    Follow(bool),
    /// Put a point of `odom` in the middle, metres.
    At([f64; 2]),
    /// Closer.
    In,
    /// Farther.
    Out,
}
