//! What demonstrations become: readers, fits, certificates, models and pictures.
//!
//! One program: what it has in common with the library is compiled once.

mod bounds;
mod common;
mod energy;
mod examples;
mod extremes;
mod frames;
mod golden;
mod import;
mod import_robots;
mod import_tables;
mod input;
mod judged;
mod modes;
mod names_and_files;
mod oracle;
mod output;
mod periodic;
mod plot;
mod thesis_oracle;
mod training;
