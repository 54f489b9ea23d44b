//! Clusters against the stretches of shore that they truly are.

use std::collections::BTreeMap;

use super::WaterWorld;
use mapping::shore::{ShoreClass as Found, ShoreCluster};
use simulation::truth::ShoreClass as Truth;

/// A cluster and the stretch of shore that most of its columns stand in.
#[derive(Clone, Debug)]
pub(crate) struct MatchedCluster {
    pub(crate) cluster: ShoreCluster,
    /// Which of the world's shores; `None` where most columns stand in none.
    pub(crate) shore: Option<usize>,
    /// What grows there.
    pub(crate) truth: Option<Truth>,
}

impl MatchedCluster {
    pub(crate) fn of(world: &WaterWorld, cell_m: f64, cluster: &ShoreCluster) -> Self {
        let shores = world.world.shores();
        let mut columns: BTreeMap<Option<usize>, usize> = BTreeMap::new();
        for &cell in &cluster.columns {
            let at = world.cell_in_world(cell, cell_m);
            let shore = shores.iter().position(|shore| shore.contains(at));
            *columns.entry(shore).or_default() += 1;
        }
        let most = columns.into_iter().max_by_key(|(_, columns)| *columns);
        let shore = most.and_then(|(shore, _)| shore);
        Self {
            cluster: cluster.clone(),
            shore,
            truth: shore
                .and_then(|shore| shores.get(shore))
                .map(|shore| shore.class),
        }
    }

    /// Whether it has the class of what grows there.
    pub(crate) fn is_right(&self) -> bool {
        let found = match self.cluster.class {
            Found::Sparse => Truth::Sparse,
            Found::Dense => Truth::Dense,
            Found::Solid => Truth::Solid,
        };
        self.truth == Some(found)
    }

    /// The mistake that must never be made.
    pub(crate) fn is_solid_called_sparse(&self) -> bool {
        self.truth == Some(Truth::Solid) && self.cluster.class == Found::Sparse
    }
}

/// What the document's table calls a class.
pub(crate) const fn found_label(class: Found) -> &'static str {
    match class {
        Found::Sparse => "Sparse",
        Found::Dense => "Dense",
        Found::Solid => "Solid",
    }
}

/// The same of the truth.
pub(crate) const fn true_label(class: Truth) -> &'static str {
    match class {
        Truth::Sparse => "Sparse",
        Truth::Dense => "Dense",
        Truth::Solid => "Solid",
    }
}
