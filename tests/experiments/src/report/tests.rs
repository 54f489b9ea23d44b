use std::sync::atomic::AtomicBool;

use super::*;
use crate::pictures::{Drawing, Image};

fn tiny() -> Outcome {
    let mut table = Table::new(&["cells of", "time, µs", "word"]);
    table.push(["0.1 m", "12.5", "fast"]);
    let picture = |name: &str, caption: &str| Picture {
        name: name.to_owned(),
        caption: caption.to_owned(),
        image: Image::Drawing(Drawing {
            width: 2,
            colors: vec![[0; 3], [255; 3]],
            pixels: vec![0, 1, 1, 0, 0, 0],
        }),
    };
    Outcome {
        checks: vec![
            Check::gate("agreement", "99.5 %", "≥ 99 %", true),
            Check::gate("a|b", "3", "0", false),
            Check::shown("drift", "0.2 m"),
        ],
        parts: vec![
            Part::text("\nWords.\n"),
            Part::Table(table),
            Part::Pictures(vec![picture("l1-a", "before"), picture("l1-b", "after")]),
        ],
    }
}

#[test]
fn a_page_says_what_was_asked_what_came_out_and_whether_it_passed() {
    let go = AtomicBool::new(false);
    let session = Session::new(20, &go, &|_| ());
    let page = page(&[(Experiment::L1, tiny())], &session);
    let (_, page) = page.split_once("This page ").unwrap();
    let expected = "\
was written by

```sh
robot-edge experiments L1 --seeds 20 --out DIR
```

| id | must show | measured |  |
| --- | --- | --- | --- |
| L1 [LRF] | occupied/free cells agree with truth ≥ 99 % of observed cells away from edges | agreement: 99.5 %; a\\|b: 3; drift: 0.2 m | **FAIL** |

## L1: Occupied and free cells agree with the truth

[LRF] Must show: occupied/free cells agree with truth ≥ 99 % of observed cells away from edges.

| what | measured, seeds 1 to 20 | required |  |
| --- | --- | --- | --- |
| agreement | 99.5 % | ≥ 99 % | pass |
| a\\|b | 3 | 0 | **FAIL** |
| drift | 0.2 m |  | shown |

Words.

| cells of | time, µs | word |
| --- | ---: | --- |
| 0.1 m | 12.5 | fast |

| before | after |
| --- | --- |
| ![before](experiments/l1-a.png) | ![after](experiments/l1-b.png) |
";
    assert_eq!(page, expected);
}

#[test]
fn the_page_and_its_pictures_are_written() {
    let go = AtomicBool::new(false);
    let session = Session::new(1, &go, &|_| ());
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("new");
    let path = write(&dir, &[(Experiment::L1, tiny())], &session).unwrap();
    assert_eq!(path, dir.join("experiments.md"));
    assert!(fs::read_to_string(path).unwrap().contains("## L1: "));
    let decoder = png::Decoder::new(io::BufReader::new(
        fs::File::open(dir.join("experiments/l1-a.png")).unwrap(),
    ));
    let reader = decoder.read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (2, 3));
    assert_eq!(
        fs::read_dir(&dir).unwrap().count(),
        2,
        "nothing temporary is left"
    );

    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = prepare(&file).unwrap_err().to_string();
    assert!(error.contains("file"), "{error}");
}
