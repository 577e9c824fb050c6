//! Starts the real processes, in folders and instances of a test's own.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Longest a process of a test may take.
const PATIENCE: Duration = Duration::from_secs(180);

/// The repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A file of the repository, as text.
pub(crate) fn file(path: &str) -> String {
    root().join(path).to_str().expect("the repository's path is UTF-8").into()
}

/// A program that `make build` or `make venv` made, or an example that comes with the tests.
pub(crate) fn program(name: &str) -> Command {
    let profile = std::env::current_exe().expect("a test has a path");
    let path = match name {
        "sim-bridge" | "python" => root().join("target/venv/bin").join(name),
        name => profile.ancestors().nth(2).expect("target/<profile>/deps/<test>").join(name),
    };
    assert!(
        path.exists(),
        "{} is missing: run `make build venv` and `cargo build --release --workspace --examples` first",
        path.display()
    );
    let mut command = Command::new(path);
    command.current_dir(root()).stdin(Stdio::null());
    command
}

/// Runs a program to its end.
pub(crate) fn run(command: &mut Command) -> Output {
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    finish(command.spawn().expect("the program starts"))
}

/// Waits for a process; one that hangs is ended and fails the test.
pub(crate) fn finish(mut child: Child) -> Output {
    let start = Instant::now();
    while child.try_wait().expect("a child can be waited for").is_none() {
        if start.elapsed() > PATIENCE {
            child.kill().expect("a child can be killed");
            let output = child.wait_with_output().expect("a child has output");
            panic!("a process did not end:\n{}", text(&output));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.wait_with_output().expect("a child has output")
}

/// All that a process said.
pub(crate) fn text(output: &Output) -> String {
    let [out, error] = [&output.stdout, &output.stderr].map(|said| String::from_utf8_lossy(said));
    format!("{out}{error}")
}

/// Reports a test that this machine cannot run, past what hides the output of tests; where it has to be
/// able to, the test fails.
pub(crate) fn skip(why: &str) {
    let required = std::env::var("TPRMP_REQUIRE_REALTIME").is_ok_and(|value| value == "1");
    assert!(!required, "TPRMP_REQUIRE_REALTIME=1, but {why}");
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

/// An empty folder and an instance name of this test's own.
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) instance: String,
}

impl Place {
    pub(crate) fn new(test: &str) -> Self {
        let instance = format!("{test}-{}", std::process::id());
        let folder = root().join("target/tests").join(&instance);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).expect("an old folder can be removed");
        }
        std::fs::create_dir_all(&folder).expect("a folder can be made");
        Self { folder, instance }
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.folder.join(name).to_str().expect("the repository's path is UTF-8").into()
    }

    /// A copy of a file of the repository with each of these texts replaced once.
    pub(crate) fn edited(&self, path: &str, edits: &[(&str, &str)]) -> String {
        let mut text = std::fs::read_to_string(file(path)).expect("the file can be read");
        for (from, to) in edits {
            assert!(text.contains(from), "`{from}` is not in {path}");
            text = text.replacen(from, to, 1);
        }
        let name = Path::new(path).file_name().and_then(|name| name.to_str());
        let copy = self.path(name.expect("a file has a name"));
        std::fs::write(&copy, text).expect("the folder can be written");
        copy
    }

    /// A copy of a configuration that names no base, in which no reason latches.
    pub(crate) fn passing(&self, path: &str) -> String {
        let text = std::fs::read_to_string(file(path)).expect("the file can be read");
        let (_, rest) = text.split_once("latching: [").expect("reasons that latch");
        let (names, _) = rest.split_once(']').expect("a list has an end");
        let robots = format!("\"{}", file("config/robots"));
        self.edited(path, &[(names, ""), ("\"../robots", &robots)])
    }

    /// Trains a shipped skill.
    pub(crate) fn train(&self, skill: &str) -> String {
        self.train_file(&file(&format!("config/skills/{skill}.ron")), &[])
    }

    /// Trains the skill of a skill file.
    pub(crate) fn train_file(&self, skill: &str, options: &[&str]) -> String {
        let name = Path::new(skill).file_stem().and_then(|name| name.to_str());
        let model = self.path(&format!("{}.model.ron", name.expect("a file has a name")));
        let output = run(program("learner").args(["train", skill, "--out", &model]).args(options));
        assert!(output.status.success(), "{}", text(&output));
        model
    }

    /// Starts a controller on this instance.
    pub(crate) fn controller(&self, config: &str, model: &str, options: &[&str]) -> Child {
        program("controller")
            .args(["run", config, "--model", model, "--instance", &self.instance])
            .args(["--summary", &self.path("controller.json")])
            .args(options)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the controller starts")
    }

    /// Files of this instance in shared memory and in the instances' folder.
    pub(crate) fn leftovers(&self) -> Vec<PathBuf> {
        let mut found: Vec<PathBuf> = std::fs::read_dir("/dev/shm")
            .expect("/dev/shm can be read")
            .flatten()
            .filter(|e| e.file_name().to_string_lossy().contains(&self.instance))
            .map(|e| e.path())
            .collect();
        for user in std::fs::read_dir("/tmp").expect("/tmp can be read").flatten() {
            if user.file_name().to_string_lossy().starts_with("tprmp-") {
                let folder = user.path().join(&self.instance);
                found.extend(folder.exists().then_some(folder));
            }
        }
        found
    }
}

/// A JSON file.
pub(crate) fn json(path: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{path}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Numbers from a seed, each below what it is asked for.
pub(crate) fn random(mut seed: u64) -> impl FnMut(u64) -> u64 {
    move |below| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (seed >> 33) % below
    }
}
