//! Tables and pictures of `docs/experiments.md`.
//!
//! `FORESHORE_EXPERIMENTS=<absolute folder> cargo test -p foreshore-tests -- --ignored --nocapture
//! experiments_report` prints the tables and, where the folder is given, writes the pictures to it.

use std::env;
use std::fs;
use std::path::PathBuf;

use super::agreement::Confusion;
use super::erosion::Erosion;
use super::error_map;
use super::l1_agreement_with_the_truth::confusion;
use super::l2_reflections::Drives;
use super::rooms::{
    SEED, SEEDS, duration_s, rooms, rooms_seen_from_one, rooms_without_reflections, run, run_with,
    truth_of,
};

#[test]
#[ignore = "prints tables and writes pictures"]
fn experiments_report() {
    agreement();
    erosion();
    settings();
    reflections();
    if let Some(folder) = env::var_os("FORESHORE_EXPERIMENTS") {
        pictures(&PathBuf::from(folder));
    }
}

fn agreement() {
    let truth = truth_of(&rooms_without_reflections());
    let confusions: Vec<Confusion> = SEEDS.map(|seed| confusion(&truth, seed)).collect();
    println!("## L1, seed {SEED}\n\n{}", confusions[0]);
    println!(
        "## L1, {} seeds\n\n| | least | median |\n| --- | ---: | ---: |",
        confusions.len()
    );
    let row = |name: &str, figure: &dyn Fn(&Confusion) -> f64, digits: usize| {
        let (least, median) = least_and_median(confusions.iter().map(figure));
        println!("| {name} | {least:.digits$} | {median:.digits$} |");
    };
    row("agreement, %", &|c| 100.0 * c.agreement(), 2);
    row("free cells alone, %", &|c| 100.0 * c.free_agreement(), 2);
    row(
        "occupied cells alone, %",
        &|c| 100.0 * c.occupied_agreement(),
        2,
    );
    row("cells compared, to be free", &|c| c.compared().0 as f64, 0);
    row(
        "cells compared, to be occupied",
        &|c| c.compared().1 as f64,
        0,
    );
    row("undecided, not compared", &|c| c.undecided() as f64, 0);
    row("left out at edges", &|c| c.left_out() as f64, 0);
    println!();
}

fn erosion() {
    let world = rooms_without_reflections();
    let erosion = Erosion::of(&world, &truth_of(&world), SEED);
    println!("## L1, surface cells that are not occupied, seed {SEED}\n");
    println!(
        "{} were and no longer are, {} never were. Beams that crossed the former without a hit in them, \
         after they were last occupied: {}, half of them at less than {:.1}° to the surface, 90 % at less than {:.1}°\n",
        erosion.undone,
        erosion.never,
        erosion.angles_deg.len(),
        erosion.quantile_deg(0.5),
        erosion.quantile_deg(0.9),
    );
}

fn settings() {
    let world = rooms_without_reflections();
    let truth = truth_of(&world);
    println!("## L1, other sensor models, seed {SEED}\n");
    println!(
        "| settings | agreement, % | free, % | occupied, % | surface cells free or undecided |"
    );
    println!("| --- | ---: | ---: | ---: | ---: |");
    let settings: [&[&str]; 4] = [
        &[],
        &["mapping.occupancy.p_free=0.4"],
        &["mapping.occupancy.p_max=0.998"],
        &[
            "mapping.occupancy.p_free=0.4",
            "mapping.occupancy.p_max=0.998",
        ],
    ];
    for settings in settings {
        let pipeline = run_with(&world, SEED, settings).finish();
        let confusion = truth.compare(&pipeline.publisher().store());
        println!(
            "| {} | {:.2} | {:.2} | {:.2} | {} |",
            label(settings),
            100.0 * confusion.agreement(),
            100.0 * confusion.free_agreement(),
            100.0 * confusion.occupied_agreement(),
            confusion.surfaces_missed(),
        );
    }
    println!();
}

fn label(settings: &[&str]) -> String {
    if settings.is_empty() {
        "p_free=0.3 p_max=0.98 (preset)".to_owned()
    } else {
        settings.join(" ").replace("mapping.occupancy.", "")
    }
}

fn reflections() {
    let truth = truth_of(&rooms());
    let drives: Vec<Drives> = SEEDS.map(|seed| Drives::of(&truth, seed)).collect();
    println!("## L2, seed {SEED}\n");
    println!(
        "| after, s | ghosts | holes in the mirror | the same, scattering mirror | ghosts, one room |"
    );
    println!("| ---: | ---: | ---: | ---: | ---: |");
    for &(at_s, errors) in &drives[0].mirror.samples {
        println!(
            "| {at_s:.0} | {} | {} | {} | {} |",
            errors.ghosts,
            errors.holes,
            drives[0].scattering.at(at_s).holes,
            drives[0].one_room.at(at_s).ghosts,
        );
    }
    println!(
        "\n## L2, {} seeds\n\n| | least | median | most |\n| --- | ---: | ---: | ---: |",
        drives.len()
    );
    let row = |name: &str, figure: &dyn Fn(&Drives) -> u64| {
        let figures = || drives.iter().map(figure);
        let (least, median) = least_and_median(figures().map(|n| n as f64));
        println!(
            "| {name} | {least} | {median} | {} |",
            figures().max().unwrap()
        );
    };
    row("most ghosts", &|drives| drives.mirror.most_ghosts().1);
    row("ghosts at the end", &|drives| drives.mirror.end().ghosts);
    row("ghosts at the end, one room only", &|drives| {
        drives.one_room.end().ghosts
    });
    row("most ghosts, scattering mirror", &|drives| {
        drives.scattering.most_ghosts().1
    });
    row("most holes in the mirror", &|drives| {
        drives.mirror.most_holes()
    });
    row("most holes, scattering mirror", &|drives| {
        drives.scattering.most_holes()
    });
    row("holes at the end", &|drives| drives.mirror.end().holes);
    row("holes at the end, scattering mirror", &|drives| {
        drives.scattering.end().holes
    });
    println!();
}

fn pictures(folder: &PathBuf) {
    fs::create_dir_all(folder).unwrap();
    let truth = truth_of(&rooms());
    let worlds = [
        ("l1-agreement", rooms_without_reflections(), duration_s()),
        // The vehicle is about to leave the room with the mirror.
        ("l2-before", rooms(), 20.0),
        ("l2-after", rooms(), duration_s()),
        ("l2-one-room", rooms_seen_from_one(), duration_s()),
    ];
    for (name, world, until_s) in worlds {
        let mut run = run(&world, SEED);
        run.advance_to(until_s);
        error_map::write(&folder.join(format!("{name}.png")), &truth, &run.store());
    }
}

fn least_and_median(figures: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut figures: Vec<f64> = figures.collect();
    figures.sort_by(f64::total_cmp);
    let half = figures.len() / 2;
    (
        figures[0],
        0.5 * (figures[half] + figures[(figures.len() - 1) / 2]),
    )
}
