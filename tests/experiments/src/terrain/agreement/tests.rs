use super::*;
use crate::outcome::Verdict;
use crate::terrain::obstacle_map;

/// Long enough for the laser to have looked at the hall.
const DURATION_S: f64 = 2.0;

#[test]
fn whatever_is_wrong_in_a_map_is_found() {
    let hall = TerrainWorld::load("hall", &[], Some(DURATION_S)).unwrap();
    let plane = hall.plane_at(0.0);
    let sweep = Sweep::of(&hall, &plane, |_| true).unwrap();
    let errorless = hall.errorless_run().unwrap().finish().unwrap();
    let map = obstacle_map(&errorless.publisher().store());
    let agreement = |map: &BTreeMap<Cell, CellClass>| Agreement::of(&hall, &plane, map, &sweep);
    let right = agreement(&map);
    assert!(right.compared > 100 && right.swept > 50, "{right:?}");
    assert_eq!((&right.missed, &right.false_obstacles), (&vec![], &vec![]));

    let find = |class, truly: bool| {
        let is_it = |cell| hall.verdict(cell, &plane).unwrap().is_obstacle == truly;
        let mut cells = map.iter();
        *cells
            .find(|(cell, found)| **found == class && is_it(**cell))
            .unwrap()
            .0
    };
    let free = find(CellClass::Free, false);
    let obstacle = find(CellClass::Obstacle, true);
    let mut wrong = map.clone();
    wrong.insert(free, CellClass::Obstacle);
    wrong.insert(obstacle, CellClass::Free);
    let wrong = agreement(&wrong);
    assert_eq!(wrong.false_obstacles, [free]);
    assert!(wrong.false_free.contains(&obstacle));
    assert!(wrong.share() < right.share());
    assert_eq!(
        wrong.missed, [[0; 2]; 0],
        "the wall beside it is still there"
    );

    let mut gone = map.clone();
    gone.retain(|_, class| *class == CellClass::Free);
    let gone = agreement(&gone);
    assert_eq!(gone.missed.len() as u64, gone.swept);
    let verdicts: Vec<_> = checks("hall", &[right, gone])
        .into_iter()
        .map(|check| check.verdict)
        .collect();
    assert_eq!(
        verdicts[..2],
        [Verdict::Passed, Verdict::Failed],
        "{verdicts:?}"
    );
}

#[test]
fn a_map_of_nothing_agrees_with_nothing() {
    let floor = TerrainWorld::load("floor", &[], Some(0.5)).unwrap();
    let plane = floor.plane_at(0.0);
    let sweep = Sweep::of(&floor, &plane, |_| false).unwrap();
    assert_eq!(sweep.cells().count(), 0);
    let nothing = Agreement::of(&floor, &plane, &BTreeMap::new(), &sweep);
    assert_eq!(checks("floor", &[nothing])[0].verdict, Verdict::Failed);
}
