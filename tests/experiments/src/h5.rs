//! H5 [HYB §8.2.2]: a dock ramp between overgrown shores.

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{SEED, Session};
use super::shores::{self, WaterWorld};
use mapping::docking::DockingSite;

/// Time between two looks, seconds.
const STEP_S: f64 = 2.0;
/// Share of a site's cells that must be on the ramp.
const ON_RAMP_MIN: f64 = 0.9;

/// One drive.
struct Drive {
    /// The sites at the end, the best first.
    sites: Vec<Site>,
    /// When the ramp was first among them, seconds.
    found_s: Option<f64>,
    /// Looks at which something else was.
    false_detections: usize,
}

/// A docking site and where it truly is.
struct Site {
    found: DockingSite,
    /// Shares of its cells.
    on_ramp: f64,
    overgrown: f64,
}

impl Site {
    fn is_ramp(&self) -> bool {
        self.on_ramp >= ON_RAMP_MIN && self.overgrown == 0.0
    }
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let dock = WaterWorld::load("dock", session.rules())?;
    let drives = session.for_each_seed("H5: dock", |seed| drive(&dock, seed))?;
    let mut parts = vec![Part::text(include_str!("notes/h5.md"))];
    if let Some(first) = drives.first() {
        parts.push(Part::Table(sites(&dock, first)));
    }
    session.step("H5: pictures")?;
    let pipeline = dock.run(SEED)?.finish()?;
    let maps = shores::octree_and_cost(&dock, &pipeline, "h5")?;
    parts.push(Part::Pictures(maps));
    let caption = "docking site and shores";
    let picture = shores::picture(&dock, &pipeline, "h5-shores", caption)?;
    parts.push(Part::Pictures(picture));
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

fn drive(dock: &WaterWorld, seed: u64) -> anyhow::Result<Drive> {
    let mut run = dock.run(seed)?;
    let (mut found_s, mut false_detections) = (None, 0);
    let samples = (run.duration_s() / STEP_S) as u32;
    for at_s in (1..=samples).map(|sample| f64::from(sample) * STEP_S) {
        run.advance_to(at_s)?;
        let sites = evaluate(dock, run.pipeline())?;
        if found_s.is_none() && sites.iter().any(Site::is_ramp) {
            found_s = Some(at_s);
        }
        false_detections += usize::from(sites.iter().any(|site| !site.is_ramp()));
    }
    Ok(Drive {
        sites: evaluate(dock, &run.finish()?)?,
        found_s,
        false_detections,
    })
}

fn evaluate(dock: &WaterWorld, pipeline: &edge::runtime::Pipeline) -> anyhow::Result<Vec<Site>> {
    let maps = dock.maps(pipeline)?;
    let cell_m = maps.voxels.octree().cell_m();
    let evaluate_site = |site: &DockingSite| {
        let cells = site.cells.iter();
        let at: Vec<_> = cells
            .map(|&cell| dock.cell_in_world(cell, cell_m))
            .collect();
        let share = |count: usize| count as f64 / at.len().max(1) as f64;
        let docks = dock.world.docks();
        let on_ramp = at
            .iter()
            .filter(|at| docks.iter().any(|dock| dock.contains(**at)));
        let shores = dock.world.shores();
        let overgrown = at
            .iter()
            .filter(|at| shores.iter().any(|shore| shore.contains(**at)));
        Site {
            on_ramp: share(on_ramp.count()),
            overgrown: share(overgrown.count()),
            found: site.clone(),
        }
    };
    Ok(maps
        .shore
        .docking_sites()
        .iter()
        // Slopes: vegetation is for an emergency.
        .filter(|site| site.vegetation.is_none())
        .map(evaluate_site)
        .collect())
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let is_first = |drive: &&Drive| drive.sites.first().is_some_and(Site::is_ramp);
    let ramps = drives.iter().filter(is_first).count();
    let sites = |is_counted: fn(&&Site) -> bool| {
        let sites = drives.iter().flat_map(|drive| &drive.sites);
        sites.filter(is_counted).count()
    };
    let overgrown = sites(|site| site.overgrown > 0.0);
    let others = sites(|site| !site.is_ramp());
    let best: Vec<_> = drives
        .iter()
        .filter_map(|drive| drive.sites.first())
        .collect();
    let cost = Spread::over(&best, |site| site.found.price);
    let heading = Spread::over(&best, |site| site.found.heading_rad.to_degrees());
    let width = Spread::over(&best, |site| site.found.width_m);
    let found = Spread::of(drives.iter().filter_map(|drive| drive.found_s));
    let false_detections: usize = drives.iter().map(|drive| drive.false_detections).sum();
    vec![
        Check::gate(
            "drives whose best docking site is the ramp",
            format!("{ramps} of {}", drives.len()),
            drives.len().to_string(),
            ramps == drives.len(),
        ),
        Check::gate(
            "docking sites that hold any of an overgrown shore",
            overgrown.to_string(),
            "0",
            overgrown == 0,
        ),
        Check::gate(
            "docking sites that are not the ramp",
            others.to_string(),
            "0",
            others == 0,
        ),
        Check::shown(
            "mean cost of the site, 0.37 by the ramp's 12°",
            cost.text(2, ""),
        ),
        Check::shown(
            "its heading, 90° straight up the ramp",
            heading.text(0, "°"),
        ),
        Check::shown("its width, of 6 m", width.text(1, " m")),
        Check::shown("when the ramp was found first", found.text(0, " s")),
        Check::shown(
            format!("looks, {STEP_S} s apart, at which there was another site"),
            false_detections.to_string(),
        ),
    ]
}

fn sites(dock: &WaterWorld, drive: &Drive) -> Table {
    let columns = [
        "docking site",
        "cells",
        "mean cost",
        "width, m",
        "heading, °",
        "centre in the world, m",
        "on the ramp",
        "overgrown",
    ];
    let mut table = Table::new(&columns);
    for (number, evaluate) in (1..).zip(&drive.sites) {
        let site = &evaluate.found;
        let centre = dock.in_world(site.centre_in_odom);
        table.push([
            format!("{number}"),
            site.cells.len().to_string(),
            format!("{:.2}", site.price),
            format!("{:.1}", site.width_m),
            format!("{:.0}", site.heading_rad.to_degrees()),
            format!("({:.1}, {:.1})", centre.x, centre.y),
            format!("{:.0} %", 100.0 * evaluate.on_ramp),
            format!("{:.0} %", 100.0 * evaluate.overgrown),
        ]);
    }
    table
}
