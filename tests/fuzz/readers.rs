//! The fuzz target that the variable `TPRMP_FUZZ` names, for cargo-fuzz.
#![no_main]

#[path = "targets.rs"]
mod targets;

use std::sync::LazyLock;

static TARGET: LazyLock<fn(&[u8])> = LazyLock::new(|| {
    let name = std::env::var("TPRMP_FUZZ").expect("TPRMP_FUZZ names a target of targets.rs");
    let target = targets::TARGETS.iter().find(|target| target.name == name);
    target.expect("TPRMP_FUZZ names a target of targets.rs").run
});

libfuzzer_sys::fuzz_target!(|data: &[u8]| TARGET(data));
