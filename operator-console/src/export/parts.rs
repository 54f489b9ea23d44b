//! Part by part into a folder: a part that cannot be written keeps no other from it, and is named at the end.

use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use protocol::packed_file::UnpackError;

use super::{ExportPart, Snapshot};
use crate::playback::in_words;

/// What came of an export.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// The files, in the order of writing.
    pub files: Vec<PathBuf>,
    /// Parts that could not be written; why, and what to do.
    pub failures: Vec<(ExportPart, String)>,
    /// Parts that were written, and are not all that the robot has; why.
    pub lacking: Vec<(ExportPart, String)>,
    /// Whether it was left before all parts were begun.
    pub is_left: bool,
}

impl Exported {
    /// In words: how many files are in `folder`, and each part that is not, one a line.
    ///
    /// # Errors
    /// The same, where parts are missing.
    pub fn outcome(&self, folder: &Path) -> Result<String, String> {
        let (count, folder) = (self.files.len(), folder.display());
        let (files, are) = if count == 1 {
            ("file", "is")
        } else {
            ("files", "are")
        };
        let mut lines = vec![if self.is_left {
            format!("Left after {count} {files}; what was written is whole, and in {folder}")
        } else {
            format!("{count} {files} {are} in {folder}")
        }];
        let failures = self.failures.iter();
        lines.extend(failures.map(|(part, why)| format!("{part} is missing: {why}")));
        let lacking = self.lacking.iter();
        lines.extend(lacking.map(|(part, why)| format!("{part} is not whole: {why}")));
        let is_whole = self.failures.is_empty() && self.lacking.is_empty() && !self.is_left;
        let words = lines.join("\n");
        if is_whole { Ok(words) } else { Err(words) }
    }
}

/// Writes `parts` to `folder`, which is made where it is missing. `take` gives what there is of each just before it is
/// written, knowing what came of those before, or ends it all.
///
/// # Errors
/// Where the folder cannot be made. A part that fails is among the failures of what is returned.
pub fn export_parts(
    folder: &Path,
    parts: impl IntoIterator<Item = ExportPart>,
    mut take: impl FnMut(ExportPart, &Exported) -> ControlFlow<(), anyhow::Result<Snapshot>>,
) -> anyhow::Result<Exported> {
    make_folder(folder)?;
    let mut exported = Exported::default();
    for part in parts {
        let ControlFlow::Continue(taken) = take(part, &exported) else {
            exported.is_left = true;
            break;
        };
        let written = taken.and_then(|snapshot| {
            let lacks = snapshot.lacks.clone();
            Ok((snapshot.write(folder)?, lacks))
        });
        match written {
            Ok((files, lacks)) => {
                exported.files.extend(files);
                exported.lacking.extend(lacks.map(|why| (part, why)));
            }
            Err(error) => exported.failures.push((part, with_advice(&error))),
        }
    }
    Ok(exported)
}

fn make_folder(folder: &Path) -> anyhow::Result<()> {
    let is_file = |path: &&Path| path.is_file();
    if let Some(file) = folder.ancestors().find(is_file) {
        let file = file.display();
        return Err(anyhow!(
            "{file} is a file and no folder. Choose another folder"
        ));
    }
    std::fs::create_dir_all(folder).with_context(|| {
        let folder = folder.display();
        format!("{folder} cannot be made, choose another folder")
    })
}

/// Why something failed, and what to do where that does not say it itself.
fn with_advice(error: &anyhow::Error) -> String {
    let why = in_words(error);
    let is_damaged = |error: &UnpackError| matches!(error, UnpackError::Damaged(_));
    let mut causes = error.chain();
    if causes
        .clone()
        .any(|cause| cause.downcast_ref().is_some_and(is_damaged))
    {
        format!("{why}. Export it again")
    } else if causes.any(<dyn std::error::Error>::is::<io::Error>) {
        format!("{why}. Make room or choose another folder, and export it again")
    } else {
        why
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;

    use protocol::layer::LayerId;

    use super::super::Content;
    use super::*;

    const PARTS: [ExportPart; 3] = [
        ExportPart::Layer(LayerId::Occupancy),
        ExportPart::Trajectory,
        ExportPart::Voxels,
    ];

    fn of(content: Content) -> Snapshot {
        Snapshot {
            content,
            lacks: None,
        }
    }

    fn trajectory() -> Snapshot {
        of(Content::Trajectory(Arc::new([])))
    }

    #[test]
    fn a_part_that_fails_keeps_no_other_from_being_written_and_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("new");
        let exported = export_parts(&folder, PARTS, |part, before| {
            assert_eq!(before.files.len(), usize::from(part == PARTS[2]));
            ControlFlow::Continue(match part {
                ExportPart::Layer(_) => Err(io::Error::other("the disk is full").into()),
                ExportPart::Trajectory => Ok(trajectory()),
                ExportPart::Shores | ExportPart::Voxels => Err(anyhow::anyhow!("too long")),
            })
        });
        let exported = exported.unwrap();
        assert_eq!(exported.files, [folder.join("trajectory.tum")]);
        assert!(folder.join("trajectory.tum").exists());
        let expected = format!(
            "1 file is in {}\n\
             occupancy is missing: the disk is full. Make room or choose another folder, and export it again\n\
             voxels is missing: too long",
            folder.display()
        );
        assert_eq!(exported.outcome(&folder), Err(expected));
    }

    #[test]
    fn what_is_not_all_that_the_robot_has_is_written_and_said() {
        let dir = tempfile::tempdir().unwrap();
        let exported = export_parts(dir.path(), [ExportPart::Trajectory], |_, _| {
            ControlFlow::Continue(Ok(trajectory().lacking("only a part".to_owned())))
        });
        let expected = format!(
            "1 file is in {}\ntrajectory is not whole: only a part",
            dir.path().display()
        );
        assert_eq!(exported.unwrap().outcome(dir.path()), Err(expected));
    }

    #[test]
    fn a_file_that_cannot_be_replaced_is_named_once() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("trajectory.tum")).unwrap();
        let exported = export_parts(dir.path(), [ExportPart::Trajectory], |_, _| {
            ControlFlow::Continue(Ok(trajectory()))
        });
        let exported = exported.unwrap();
        let [(ExportPart::Trajectory, why)] = &exported.failures[..] else {
            panic!("{exported:?}");
        };
        assert_eq!(why.matches("trajectory.tum").count(), 1, "{why}");
        assert_eq!(why.matches("directory").count(), 1, "{why}");
        assert!(why.ends_with("export it again"), "{why}");
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_said_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        let actual = format!(
            "{} is a file and no folder. Choose another folder",
            file.display()
        );
        for folder in [file.join("maps"), file] {
            let error = export_parts(&folder, PARTS, |_, _| unreachable!()).unwrap_err();
            assert_eq!(error.to_string(), actual);
        }
    }

    #[test]
    fn what_is_left_says_how_much_is_there() {
        let dir = tempfile::tempdir().unwrap();
        let exported = export_parts(dir.path(), PARTS, |part, _| match part {
            ExportPart::Layer(_) => ControlFlow::Continue(Ok(of(Content::Nothing))),
            ExportPart::Trajectory => ControlFlow::Continue(Ok(trajectory())),
            ExportPart::Shores | ExportPart::Voxels => ControlFlow::Break(()),
        });
        let exported = exported.unwrap();
        assert!(exported.is_left);
        let words = exported.outcome(dir.path()).unwrap_err();
        assert!(words.starts_with("Left after 1 file; what"), "{words}");
    }
}
