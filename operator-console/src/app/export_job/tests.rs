use std::fs;

use super::*;

fn ended(ended: Result<&str, &str>, opens_folder: bool) -> ExportJob {
    ExportJob {
        progress: Arc::new(Mutex::new(ExportProgress {
            folder: PathBuf::from("maps"),
            ended: Some(ended.map(str::to_owned).map_err(str::to_owned)),
            ..ExportProgress::default()
        })),
        is_cancelled: Arc::default(),
        opens_folder,
        is_end_reported: false,
    }
}

#[test]
fn the_end_of_an_export_is_told_once() {
    let mut job = ended(Ok("3 files are in maps"), true);
    let words = lock(&job.progress).ended.take();
    assert_eq!(job.take_end(), None);
    lock(&job.progress).ended = words;
    let end = ExportEnd {
        note: (Severity::Info, "export", "3 files are in maps".to_owned()),
        folder: Some(PathBuf::from("maps")),
    };
    assert_eq!(job.take_end(), Some(end));
    assert_eq!(job.take_end(), None);
}

#[test]
fn a_folder_is_shown_only_where_that_is_wanted_and_all_is_in_it() {
    let end = ended(Ok("all"), false).take_end().unwrap();
    assert_eq!(end.folder, None);
    let end = ended(Err("2 files\ncost is missing"), true)
        .take_end()
        .unwrap();
    assert_eq!(end.folder, None);
    let words = "2 files; cost is missing".to_owned();
    assert_eq!(end.note, (Severity::Warning, "export", words));
}

#[test]
fn only_of_its_own_folder_it_says_that_it_could_not_be_opened() {
    let job = ended(Ok("all"), true);
    job.not_opened(Path::new("recordings"), "no");
    assert_eq!(job.progress().unopened, None);
    job.not_opened(Path::new("maps"), "no");
    assert_eq!(job.progress().unopened.as_deref(), Some("no"));
}

#[test]
fn what_is_fetched_moves_the_bar() {
    let progress = ExportProgress {
        parts: [3, 4],
        fetching: Some(Fetching::Poses([1, 2])),
        ..ExportProgress::default()
    };
    assert_eq!(progress.share().to_bits(), 0.875_f32.to_bits());
    assert_eq!(
        ExportProgress::default().share().to_bits(),
        0.0_f32.to_bits()
    );
}

fn exported(
    folder: &std::path::Path,
    last: ExportPart,
    is_cancelled: bool,
) -> (Result<String, String>, usize) {
    let request = ExportRequest {
        folder: folder.to_owned(),
        parts: [ExportPart::Trajectory, last].into(),
        opens_folder: false,
    };
    let model = ModelHandle::of(crate::test_support::scout());
    let progress = Mutex::default();
    let ended = write(
        &request,
        &model,
        &progress,
        &AtomicBool::new(is_cancelled),
        &|| {},
    );
    (ended, progress.into_inner().unwrap().files)
}

#[test]
fn what_cannot_be_written_is_said_and_the_rest_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let (ended, files) = exported(dir.path(), ExportPart::Shores, false);
    let folder = dir.path().display();
    let expected = format!(
        "1 file is in {folder}\n\
         trajectory is not whole: only what was received here: no data from the robot"
    );
    assert_eq!(ended, Err(expected));
    assert_eq!(files, 1);

    fs::remove_file(dir.path().join("trajectory.tum")).unwrap();
    fs::create_dir(dir.path().join("trajectory.tum")).unwrap();
    let (ended, files) = exported(dir.path(), ExportPart::Shores, false);
    let why = ended.unwrap_err();
    assert!(
        why.starts_with(&format!("0 files are in {folder}\ntrajectory is missing")),
        "{why}"
    );
    assert_eq!(files, 0);

    let (ended, _) = exported(dir.path(), ExportPart::Shores, true);
    assert!(ended.unwrap_err().starts_with("Left after 0 files"));
}

#[test]
fn an_octree_that_does_not_come_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let (ended, files) = exported(dir.path(), ExportPart::Voxels, false);
    let why = ended.unwrap_err();
    let missing = "\nvoxels is missing: no data from the robot. Export it again later";
    assert!(why.contains(missing), "{why}");
    assert_eq!(files, 1, "the way");
}
