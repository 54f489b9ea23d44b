use super::*;

const CELL_M: f32 = 0.3;

fn site(x_m: f32, y_m: f32, width_m: f32) -> DockingSite {
    DockingSite {
        center_m: [x_m, y_m],
        heading_rad: 1.0,
        width_m,
        mean_cost: 0.2,
    }
}

/// The letters of the next list, with blanks between.
fn next(names: &mut SiteNames, sites: &[DockingSite]) -> String {
    let letters: Vec<_> = names.name(sites).iter().map(SiteName::to_string).collect();
    letters.join(" ")
}

#[test]
fn sites_that_change_ranks_keep_their_letters() {
    let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
    let mut names = SiteNames::default();
    let first = names.name(&[ramp, bank]);
    let swapped = names.name(&[bank, ramp]);
    assert_eq!(
        first.iter().map(SiteName::to_string).collect::<String>(),
        "AB"
    );
    assert_eq!(swapped, [first[1], first[0]]);
    let between = site(0.0, 5.0, 4.0);
    assert_eq!(next(&mut names, &[between, bank, ramp]), "C B A");
}

#[test]
fn a_site_that_creeps_on_by_cells_keeps_its_letter() {
    let mut names = SiteNames::default();
    // In the end far from where it was widest.
    assert_eq!(next(&mut names, &[site(0.0, 0.0, 6.0)]), "A");
    for step in 1..100 {
        let here = site(step as f32 * CELL_M, 0.0, 1.6);
        assert_eq!(next(&mut names, &[here]), "A", "step {step}");
    }
}

#[test]
fn a_bank_that_comes_into_sight_keeps_its_letter_however_fast_it_grows() {
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[site(0.0, 0.0, 2.0)]), "A");
    // From 1 m before the old middle to 59 m behind it.
    assert_eq!(next(&mut names, &[site(29.0, 0.0, 60.0)]), "A");
    assert_eq!(next(&mut names, &[site(57.0, 0.0, 4.0)]), "A");
    // Half of the greater width, and no more.
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[site(0.0, 0.0, 4.0)]), "A");
    assert_eq!(next(&mut names, &[site(2.0, 0.0, 3.0)]), "A");
    assert_eq!(next(&mut names, &[site(4.01, 0.0, 3.0)]), "B");
}

#[test]
fn a_bank_that_grows_over_where_others_were_keeps_its_letter() {
    // As in the simulated lake, within four seconds.
    let mut names = SiteNames::default();
    let (bank, piece) = (site(41.4, -25.6, 26.7), site(62.7, -26.5, 3.4));
    assert_eq!(next(&mut names, &[bank, piece]), "A B");
    assert_eq!(next(&mut names, &[site(49.5, -25.8, 43.8)]), "A");
    assert_eq!(next(&mut names, &[site(63.0, -26.3, 70.0)]), "A");
    // Where they part again, each is what it was.
    assert_eq!(next(&mut names, &[piece, bank]), "B A");
}

#[test]
fn two_near_sites_do_not_exchange_their_letters() {
    let mut names = SiteNames::default();
    let two = [site(0.0, 0.0, 4.0), site(2.9, 0.0, 4.0)];
    assert_eq!(next(&mut names, &two), "A B");
    // Both move on together, so far that the first is nearer to where the second was than to where it was itself.
    let moved = [site(1.6, 0.0, 4.0), site(3.1, 0.0, 4.0)];
    assert_eq!(next(&mut names, &moved), "A B");
    // Side by side, one goes as another comes on its other side.
    let mut names = SiteNames::default();
    let (left, middle, right) = (
        site(-5.0, 0.0, 5.0),
        site(0.0, 0.0, 5.0),
        site(5.0, 0.0, 5.0),
    );
    assert_eq!(next(&mut names, &[left, middle]), "A B");
    assert_eq!(next(&mut names, &[right, middle]), "C B");
    assert_eq!(next(&mut names, &[middle, left, right]), "B A C");
}

#[test]
fn a_site_that_comes_back_takes_its_letter_again() {
    let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[ramp, bank]), "A B");
    assert_eq!(next(&mut names, &[bank]), "B");
    assert_eq!(next(&mut names, &[]), "");
    // Its letter is not given to another meanwhile.
    assert_eq!(next(&mut names, &[site(0.0, 30.0, 4.0)]), "C");
    assert_eq!(next(&mut names, &[site(10.5, 1.0, 3.0), bank]), "A B");
}

#[test]
fn a_long_bank_is_known_again_by_either_end() {
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[site(0.0, 0.0, 20.0)]), "A");
    // What leaves the window last is one end; what is seen first on the way back, the other.
    assert_eq!(next(&mut names, &[site(9.0, 0.0, 2.0)]), "A");
    assert_eq!(next(&mut names, &[]), "");
    assert_eq!(next(&mut names, &[site(-9.0, 0.0, 2.0)]), "A");
}

#[test]
fn two_sites_that_were_one_for_a_moment_are_as_before() {
    let (left, right) = (site(-4.0, 0.0, 6.0), site(4.0, 0.0, 6.0));
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[left, right]), "A B");
    let both = next(&mut names, &[site(0.5, 0.0, 15.0)]);
    assert_eq!(both, "B");
    assert_eq!(next(&mut names, &[left, right]), "A B");
}

#[test]
fn a_part_of_what_was_two_once_keeps_the_letter_of_both() {
    let (left, right) = (site(-4.0, 0.0, 6.0), site(4.0, 0.0, 6.0));
    let both = [site(0.5, 0.0, 15.0)];
    let mut names = SiteNames::default();
    assert_eq!(next(&mut names, &[left, right]), "A B");
    // Its left half alone lies where A was.
    for part in [&left, &right, &left] {
        assert_eq!(next(&mut names, &both), "B");
        assert_eq!(next(&mut names, std::slice::from_ref(part)), "B");
    }
    assert_eq!(next(&mut names, &both), "B");
    assert_eq!(next(&mut names, &[left, right]), "A B");
    // Apart again, each is itself, whichever is in sight.
    for (site, letter) in [(right, "B"), (left, "A"), (right, "B")] {
        assert_eq!(next(&mut names, &[site]), letter);
    }
}

#[test]
fn after_z_comes_aa() {
    let mut names = SiteNames::default();
    let sites: Vec<_> = (0..703)
        .map(|at| site(at as f32 * 10.0, 0.0, 4.0))
        .collect();
    let names = names.name(&sites);
    let letters: Vec<_> = names.iter().map(SiteName::to_string).collect();
    for (name, letters) in names.iter().zip(&letters) {
        assert_eq!(name.letters() as usize, letters.len(), "{letters}");
    }
    assert_eq!(
        [0, 7, 8, 23, 24, 25, 47, 48, 599, 600].map(|at| &letters[at]),
        ["A", "H", "J", "Z", "AA", "AB", "AZ", "BA", "ZZ", "AAA"]
    );
}

#[test]
fn what_was_not_seen_for_the_longest_is_forgotten_first() {
    let mut names = SiteNames::default();
    let (first, second) = (site(0.0, 0.0, 4.0), site(0.0, 50.0, 4.0));
    assert_eq!(next(&mut names, &[first, second]), "A B");
    for at in 0..MAX_PLACES - 1 {
        names.name(&[site(10.0 + at as f32 * 10.0, 0.0, 4.0), second]);
        assert!(names.places.len() <= MAX_PLACES);
    }
    let again = names.name(&[second, first]);
    assert_eq!(again[0].to_string(), "B");
    assert_eq!(
        again[1].index,
        MAX_PLACES as u64 + 1,
        "a letter that was never used"
    );
}

#[test]
fn names_of_before_name_nothing_once_they_begin_anew() {
    let (ramp, bank) = (site(10.0, 0.0, 4.0), site(-10.0, 0.0, 4.0));
    let mut names = SiteNames::default();
    let before = names.name(&[ramp, bank]);
    names.restart();
    let after = names.name(&[bank, ramp]);
    assert_eq!(
        after.iter().map(SiteName::to_string).collect::<String>(),
        "AB"
    );
    assert!(before.iter().all(|name| !after.contains(name)));
}

#[test]
fn whatever_a_robot_sends_each_site_has_a_name_of_its_own() {
    let mut names = SiteNames::default();
    let odd = [
        site(0.0, 0.0, 0.0),
        site(0.0, 0.0, -1.0),
        site(0.0, 0.0, f32::MAX),
        site(f32::MAX, f32::MIN, f32::MAX),
        site(f32::NAN, 0.0, f32::INFINITY),
    ];
    for _ in 0..3 {
        let found = names.name(&odd);
        for (at, name) in found.iter().enumerate() {
            assert!(!found[..at].contains(name), "{found:?}");
        }
    }
    assert!(names.places.len() <= 3 * odd.len());
}
