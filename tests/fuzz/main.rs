//! A short run of the fuzz targets: good files, damaged at random from fixed seeds, and what was found before.
//! `TPRMP_FUZZ_CASES=100000` runs longer, without a nightly compiler.

mod targets;

use std::path::{Path, PathBuf};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use targets::{TARGETS, Target};

/// Damaged files a target, unless `TPRMP_FUZZ_CASES` says otherwise.
const CASES: usize = 400;
/// What numbers, brackets and bytes are replaced by.
const DICTIONARY: [&[u8]; 16] = [
    b"1e308",
    b"-1e308",
    b"1e-320",
    b"0",
    b"-1",
    b"NaN",
    b"inf",
    b"1e999",
    b"18446744073709551616",
    b"((((((((((((((((",
    b"[[[[[[[[[[[[[[[[",
    b"\"",
    b"/*",
    b"\xff\xfe",
    b"\0\0\0\0\0\0\0\0",
    b"\xff\xff\xff\x7f\xff\xff\xff\xff",
];

fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<_> = entries.map(|entry| entry.path()).collect();
    files.retain(|file| file.is_file() && file.extension().is_some_and(|e| e == extension));
    files.sort();
    files
}

fn damaged(good: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut data = good.to_vec();
    for _ in 0..random.random_range(1..5) {
        let at = random.random_range(0..=data.len());
        let end = (at + random.random_range(0..40)).min(data.len());
        let word = DICTIONARY[random.random_range(0..DICTIONARY.len())];
        match random.random_range(0..7) {
            0 if at < data.len() => data[at] ^= 1 << random.random_range(0..8),
            1 => data.truncate(at),
            2 => drop(data.drain(at..end)),
            3 => drop(data.splice(at..at, word.iter().copied())),
            4 => {
                let again = data[at..end].repeat(random.random_range(1..200));
                data.splice(at..at, again);
            }
            // A number, from its first digit to its last.
            _ => {
                let is_digit = |byte: &u8| byte.is_ascii_digit() || b".-+e".contains(byte);
                if let Some(first) = data[at..].iter().position(is_digit).map(|i| at + i) {
                    let rest = data[first..].iter().position(|byte| !is_digit(byte));
                    let last = rest.map_or(data.len(), |length| first + length);
                    data.splice(first..last, word.iter().copied());
                }
            }
        }
    }
    data
}

fn run(target: &Target) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = files(&root.join("tests/fuzz/corpus").join(target.name), target.extension);
    let good = files(&root.join(target.seeds), target.extension);
    assert!(!good.is_empty(), "{}: there are no good files in {}", target.name, target.seeds);
    let read = |file: &PathBuf| std::fs::read(file).unwrap();
    for file in found.iter().chain(&good) {
        (target.run)(&read(file));
    }
    let good: Vec<Vec<u8>> = good.iter().map(read).collect();
    let cases = std::env::var("TPRMP_FUZZ_CASES").map_or(CASES, |n| n.parse().unwrap());
    for seed in 0..cases {
        let mut random = ChaCha8Rng::seed_from_u64(seed as u64);
        let data = damaged(&good[seed % good.len()], &mut random);
        let outcome = std::panic::catch_unwind(|| (target.run)(&data));
        assert!(outcome.is_ok(), "{}, seed {seed}: it panicked", target.name);
    }
}

macro_rules! short_runs {
    ($($name:ident)+) => {
        $(#[test]
        fn $name() {
            run(TARGETS.iter().find(|target| target.name == stringify!($name)).unwrap());
        })+

        #[test]
        fn every_target_has_a_run() {
            assert_eq!(TARGETS.map(|target| target.name), [$(stringify!($name)),+]);
        }
    };
}

short_runs! { urdf model configuration frames skill demonstration csv npz mat thesis messages }
