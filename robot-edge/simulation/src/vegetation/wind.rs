//! Wind, and how it moves what grows.

use nalgebra::Vector2;

/// A breeze that never changes its mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Where it blows to: a unit vector.
    pub towards: Vector2<f64>,
    /// How far the top of a plant of stiffness 1 leans on the mean, by its height.
    pub lean: f64,
    /// How far that top swings to either side of the mean, by its height.
    pub sway: f64,
    /// Of its slow swinging, seconds.
    pub period_s: f64,
}

/// The wind of one instant: for every component sine and cosine of the angle that it has run through.
#[derive(Clone, Copy, Debug)]
pub struct Gust {
    towards: Vector2<f64>,
    lean: f64,
    sway: f64,
    turned: [[f64; 2]; COMPONENTS],
}

/// Sine and cosine of where every component of a plant's swinging begins.
pub type Phases = [[f32; 2]; COMPONENTS];

/// A plant swings at its own period and at others, so that it never comes back to where it was. The ratios
/// are powers of the golden one, which no small whole numbers approximate; so no two beats coincide.
pub const COMPONENTS: usize = 3;
const PERIOD_RATIOS: [f64; COMPONENTS] = [1.0, 0.618_033_988_749_895, 2.618_033_988_749_895];
/// They sum up to 1, the most that a top swings.
const WEIGHTS: [f64; COMPONENTS] = [0.6, 0.25, 0.15];

/// How far it swings across the wind, by how far along it.
const ACROSS: f64 = 0.4;

impl Wind {
    /// No wind.
    pub const CALM: Self = Self {
        towards: Vector2::new(1.0, 0.0),
        lean: 0.0,
        sway: 0.0,
        period_s: 1.0,
    };

    /// The wind at a time in seconds since the beginning.
    pub fn at(&self, time_s: f64) -> Gust {
        let turned = PERIOD_RATIOS.map(|ratio| {
            let turns = time_s / (self.period_s * ratio);
            let angle_rad = std::f64::consts::TAU * (turns - libm::floor(turns));
            [libm::sin(angle_rad), libm::cos(angle_rad)]
        });
        Gust {
            towards: self.towards,
            lean: self.lean,
            sway: self.sway,
            turned,
        }
    }

    /// No point of a plant of this reach is ever farther from where it stands without wind, metres.
    pub fn farthest_m(&self, reach_m: f64) -> f64 {
        reach_m * (self.lean + self.sway + ACROSS * self.sway)
    }
}

impl Gust {
    /// How far the top of a plant of these phases is moved, by its reach.
    pub fn offset(&self, phases: &Phases) -> Vector2<f64> {
        let (mut along, mut across) = (0.0, 0.0);
        for (n, ([sin, cos], weight)) in self.turned.iter().zip(WEIGHTS).enumerate() {
            let [start_sin, start_cos] = phases[n].map(f64::from);
            along += weight * (sin * start_cos + cos * start_sin);
            // The next component's beginning, so that it does not run on a line.
            let [start_sin, start_cos] = phases[(n + 1) % COMPONENTS].map(f64::from);
            across += weight * (sin * start_cos + cos * start_sin);
        }
        let aside = Vector2::new(-self.towards.y, self.towards.x);
        self.towards * (self.lean + self.sway * along) + aside * (ACROSS * self.sway * across)
    }
}
