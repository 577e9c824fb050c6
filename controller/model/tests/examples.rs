//! The examples do what they say.

use std::path::Path;

#[expect(dead_code, reason = "an example is a program of its own")]
#[path = "../examples/rollout.rs"]
mod rollout;

#[test]
fn the_rollout_reaches_the_goal() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tprmp-model-5.ron");
    assert!(rollout::rollout(Path::new(path)).unwrap() < 1e-3);
}
