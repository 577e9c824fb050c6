//! Progress bars.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar, drawn on a terminal only.
pub(crate) fn progress(name: &'static str, length: usize) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{msg:<10} {bar:40} {pos}/{len} {elapsed} (eta {eta})")
            .expect("the template is well formed");
    let bar = ProgressBar::new(length as u64).with_style(style).with_message(name);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
