//! What the program prints, to readers that have gone and to disks that are full.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::common::{Folder, arcs, skill_text};
use tprmp_model::skill_model::Manifold;

/// A skill file with its demonstrations, and a model of it.
fn trained(folder: &Folder) -> (PathBuf, PathBuf) {
    folder.demonstrations("demonstrated", &arcs(Manifold::R2));
    let skill = folder.write("skill.ron", &skill_text("planar.ron"));
    let model = folder.path().join("model.ron");
    let output = run(&train(&skill, &model), Stdio::null(), Stdio::piped());
    assert!(output.status.success(), "{}", text(&output));
    (skill, model)
}

fn train<'a>(skill: &'a Path, model: &'a Path) -> [&'a Path; 4] {
    [Path::new("train"), skill, Path::new("--out"), model]
}

fn run(arguments: &[&Path], out: Stdio, err: Stdio) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_learner"));
    command.args(arguments).stdout(out).stderr(err).spawn().unwrap().wait_with_output().unwrap()
}

/// A pipe that nobody reads.
fn deserted() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_reader_that_has_gone_is_no_reason_to_fail() {
    let folder = Folder::new("deserted");
    let (skill, model) = trained(&folder);
    let again = folder.path().join("again.ron");
    for arguments in [&train(&skill, &again)[..], &[Path::new("inspect"), &model]] {
        let output = run(arguments, deserted(), Stdio::piped());
        assert_eq!((output.status.code(), text(&output)), (Some(0), String::new()));
    }
    assert_eq!(std::fs::read(again).unwrap(), std::fs::read(model).unwrap());

    let missing = [Path::new("inspect"), Path::new("no-such-file.ron")];
    assert_eq!(run(&missing, deserted(), deserted()).status.code(), Some(1));
}

#[test]
fn a_full_disk_is_an_error() {
    let folder = Folder::new("full");
    let (skill, model) = trained(&folder);
    let again = folder.path().join("again.ron");
    for arguments in [&train(&skill, &again)[..], &[Path::new("inspect"), &model]] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = run(arguments, full.into(), Stdio::piped());
        let said = text(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.starts_with("learner: standard output cannot be written"), "{said}");
    }
}
