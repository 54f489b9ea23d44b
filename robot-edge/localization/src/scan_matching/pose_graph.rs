//! Pose graph: poses in the plane and measured differences between them, made consistent by least squares.
//!
//! G. Grisetti, R. Kümmerle, C. Stachniss, W. Burgard, "A Tutorial on Graph-Based SLAM", IEEE ITS Magazine 2010; the
//! kernel of closures is dynamic covariance scaling (P. Agarwal, G. Tipaldi, L. Spinello, C. Stachniss, W. Burgard,
//! "Robust Map Optimization Using Dynamic Covariance Scaling", ICRA 2013, equation 15), which is the closed
//! form of switchable constraints.

use nalgebra::{Isometry2, Matrix3, Vector3};

use super::block_solver::BlockSystem;
use super::position_fixes::PositionFix;
use super::submap::{adjoint, moved};

/// A position stands for the keyframes of its 2 m, each of which two submaps hold: what these say of a drift is not independent.
const FIX_WEIGHT: f64 = 20.0;
/// Positions lose weight at this share of the squared error at which closures do: their errors last, so that many agree on a wrong one.
const FIX_SHARE: f64 = 0.3;
/// Fixes the first pose, where no position on Earth does.
const FIXED_INFORMATION: f64 = 1e12;

/// A measured difference of two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Index of the pose from which it was measured.
    pub from: u32,
    /// Index of the pose that was measured.
    pub to: u32,
    /// Pose `to` in the frame of pose `from`.
    pub from_from_to: Isometry2<f64>,
    /// Inverse covariance of x, y (metres) and yaw (radians) in the frame of pose `to`.
    pub information: Matrix3<f64>,
    /// It may be wrong.
    pub is_closure: bool,
}

/// Poses and edges.
#[derive(Clone, Debug, Default)]
pub struct PoseGraph {
    /// Each in the frame of the map.
    pub poses: Vec<Isometry2<f64>>,
    /// In the order in which they were measured.
    pub edges: Vec<Edge>,
    /// Positions on Earth, in the order in which they were measured.
    pub fixes: Vec<PositionFix>,
}

/// A step of Gauss and Newton under way.
#[derive(Clone, Debug)]
pub struct GraphStep {
    system: BlockSystem,
    /// Edges that were added to it.
    edges: usize,
}

impl Edge {
    /// The error in the frame of pose `to`, and its derivative by a step of pose `to`.
    fn error(&self, from: &Isometry2<f64>, to: &Isometry2<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let error = self.from_from_to.inv_mul(&from.inv_mul(to));
        let turn = error.rotation.to_rotation_matrix();
        let mut by_to = Matrix3::identity();
        by_to.fixed_view_mut::<2, 2>(0, 0).copy_from(turn.matrix());
        let Isometry2 {
            translation: t,
            rotation,
        } = error;
        (Vector3::new(t.x, t.y, rotation.angle()), by_to)
    }
}

impl PoseGraph {
    /// The squared error of an edge in standard deviations.
    pub fn chi2(&self, edge: &Edge) -> f64 {
        let [from, to] = [edge.from, edge.to].map(|at| &self.poses[at as usize]);
        let (error, _) = edge.error(from, to);
        error.dot(&(edge.information * error))
    }

    /// Goes on with a step of Gauss and Newton by at most so many edges and as many poses; a closure with a squared error of more than
    /// `full_weight_chi2` has less weight. At its end, returns the greatest step of a pose: metres, and radians as metres at 1 m.
    pub fn advance(
        &mut self,
        step: &mut Option<GraphStep>,
        most: usize,
        full_weight_chi2: f64,
    ) -> Option<f64> {
        let GraphStep { system, edges } = step.get_or_insert_with(|| {
            let mut system = BlockSystem::new(self.poses.len());
            let aligned = self.fixes.iter().filter(|fix| fix.is_aligned);
            for fix in aligned.clone() {
                self.add_fix(&mut system, fix, full_weight_chi2);
            }
            if aligned.count() == 0 {
                system.add_diagonal(0, &(Matrix3::identity() * FIXED_INFORMATION));
            }
            GraphStep { system, edges: 0 }
        });
        if *edges < self.edges.len() {
            for edge in self.edges.iter().skip(*edges).take(most) {
                self.add_edge(system, edge, full_weight_chi2);
            }
            *edges += most;
            if *edges < self.edges.len() {
                return None;
            }
        }
        if !system.eliminate(most) {
            return None;
        }
        let mut greatest = 0.0_f64;
        for (pose, step) in self.poses.iter_mut().zip(&system.solution()) {
            *pose = moved(pose, step);
            greatest = greatest.max(step.amax());
        }
        *step = None;
        Some(greatest)
    }

    fn add_edge(&self, system: &mut BlockSystem, edge: &Edge, full_weight_chi2: f64) {
        let [from, to] = [edge.from, edge.to].map(|at| &self.poses[at as usize]);
        let (error, by_to) = edge.error(from, to);
        let by_from = -by_to * adjoint(&to.inv_mul(from));
        let mut information = edge.information;
        if edge.is_closure {
            let chi2 = error.dot(&(information * error));
            information *= robust_weight(chi2, full_weight_chi2);
        }
        let (weighted_from, weighted_to) = (
            by_from.transpose() * information,
            by_to.transpose() * information,
        );
        system.add_diagonal(edge.from, &(weighted_from * by_from));
        system.add_diagonal(edge.to, &(weighted_to * by_to));
        system.add_pair(edge.from, edge.to, &(weighted_from * by_to));
        system.add_right(edge.from, &-(weighted_from * error));
        system.add_right(edge.to, &-(weighted_to * error));
    }

    fn add_fix(&self, system: &mut BlockSystem, fix: &PositionFix, full_weight_chi2: f64) {
        let (error, by_step) = fix.error(&self.poses[fix.keyframe as usize]);
        let full_weight_chi2 = FIX_SHARE * full_weight_chi2;
        let weight = FIX_WEIGHT * robust_weight(error.norm_squared(), full_weight_chi2);
        let weighted = by_step.transpose() * weight;
        system.add_diagonal(fix.keyframe, &(weighted * by_step));
        system.add_right(fix.keyframe, &-(weighted * error));
    }
}

/// Of dynamic covariance scaling: 1 up to a squared error of `full_weight_chi2`.
fn robust_weight(chi2: f64, full_weight_chi2: f64) -> f64 {
    let share = (2.0 * full_weight_chi2 / (full_weight_chi2 + chi2)).min(1.0);
    share * share
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    fn edge(from: u32, to: u32, between: Isometry2<f64>, is_closure: bool) -> Edge {
        let information = Matrix3::from_diagonal(&Vector3::new(400.0, 400.0, 3000.0));
        Edge {
            from,
            to,
            from_from_to: between,
            information,
            is_closure,
        }
    }

    /// A square of 40 steps of 1 m, measured too long and turning by 0.5° a step.
    fn square() -> (Vec<Isometry2<f64>>, PoseGraph) {
        let turn = |at: u32| {
            if at.is_multiple_of(10) {
                std::f64::consts::FRAC_PI_2
            } else {
                0.0
            }
        };
        let mut truth = vec![Isometry2::identity()];
        let mut graph = PoseGraph {
            poses: truth.clone(),
            ..PoseGraph::default()
        };
        for at in 1..=40 {
            let step = Isometry2::new(Vector2::new(1.0, 0.0), turn(at));
            truth.push(truth[truth.len() - 1] * step);
            let measured = Isometry2::new(Vector2::new(1.02, 0.0), turn(at) + 0.009);
            graph
                .poses
                .push(graph.poses[graph.poses.len() - 1] * measured);
            graph.edges.push(edge(at - 1, at, measured, false));
        }
        (truth, graph)
    }

    fn optimize(graph: &mut PoseGraph) -> f64 {
        let mut step = |chi2| {
            let mut under_way = None;
            // In parts of any size.
            std::iter::repeat_with(|| graph.advance(&mut under_way, 7, chi2)).find_map(|step| step)
        };
        for chi2 in [1e5, 2e4, 4e3, 800.0, 160.0, 32.0] {
            step(chi2);
        }
        (0..10).map(|_| step(10.0)).last().flatten().unwrap()
    }

    #[test]
    fn closures_straighten_a_square_and_a_wrong_one_is_recognised() {
        let (truth, mut graph) = square();
        for (from, to) in [(0, 40), (1, 39), (2, 38), (0, 39)] {
            let between = truth[from as usize].inv_mul(&truth[to as usize]);
            graph.edges.push(edge(from, to, between, true));
        }
        let wrong = Isometry2::new(Vector2::new(0.3, 0.2), 0.1);
        graph.edges.push(edge(10, 30, wrong, true));
        let last_step = optimize(&mut graph);
        assert!(last_step < 1e-6, "{last_step}");
        let chi2: Vec<f64> = graph.edges[40..]
            .iter()
            .map(|edge| graph.chi2(edge))
            .collect();
        assert!(
            chi2[..4].iter().all(|chi2| *chi2 < 2.0) && chi2[4] > 1000.0,
            "{chi2:?}"
        );
        for (pose, truth) in graph.poses.iter().zip(&truth) {
            let error = (pose.translation.vector - truth.translation.vector).norm();
            assert!(error < 0.6, "{error}");
        }
        let end = graph.poses[0].inv_mul(&graph.poses[40]);
        assert!(end.translation.vector.norm() < 0.02, "{end}");
    }
}
