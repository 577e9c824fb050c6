//! The experiments of the thesis, and harder ones, on any set of demonstrations.
//!
//! [`run`](run::run) trains what is compared (`models`), makes every rollout of `cases`, `stability` and
//! `grid` in the [`world`] of its [`conditions`], compares it with its demonstration ([`measures`]), and writes `results.json`, one row a rollout
//! (`results`), and `report.html` (`report`): each figure beside what the thesis published
//! (`published`), and a table of what the default policy must do (`verdict`).

pub mod baselines;
mod bench;
mod body;
mod case;
mod cases;
pub mod conditions;
pub mod dataset;
pub mod error;
mod experiment;
mod grid;
pub mod measures;
mod metric;
mod models;
mod path;
pub mod people;
mod prepared;
mod progress;
mod published;
mod report;
mod results;
pub mod run;
mod scale;
mod stability;
mod verdict;
pub mod world;
