//! What counts as rest, as noise, and as a nudge: the bounds that the command line can change.
//!
//! The defaults suit a simulator without noise as well as encoders with 1 mrad of noise, servos that
//! count 4096 steps a rotation, and cameras with 3 mm: each bound is what is allowed *beyond* what the
//! measured noise explains.

use super::statistics::Extent;

/// Measured noise explains what is within so many standard errors: a false alarm every few thousand
/// windows if the noise is normal, while a bound is added to it.
const STANDARD_ERRORS: f64 = 4.0;

/// What counts as rest, as noise, and as a nudge.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct Bounds {
    /// A motion begins and ends with so long a rest of the arm; frames rest as long before it [s]
    #[arg(long, value_name = "S", default_value_t = Self::default().rest_s, value_parser = seconds)]
    pub(super) rest_s: f64,
    /// Speeds are means over this time, at most `--rest-s` [s]; longer is steadier and reacts later
    // At 50 Hz it holds 25 states: 1 mrad in each joint of a stretched arm is 1.5 mm at the tool, and
    // its mean speed then has a standard error of 2.4 mm/s, well below the bound.
    #[arg(long, value_name = "S", default_value_t = Self::default().rest_window_s, value_parser = seconds)]
    pub(super) rest_window_s: f64,
    /// The tool rests below this speed, beyond what its noise explains [m/s]
    // A hand that holds an arm still moves it by a millimetre or two a second.
    #[arg(long, value_name = "M_S", default_value_t = Self::default().rest_speed_m_s, value_parser = positive)]
    pub(super) rest_speed_m_s: f64,
    /// … and when it rotates slower than this [rad/s]
    #[arg(long, value_name = "RAD_S", default_value_t = Self::default().rest_speed_rad_s, value_parser = positive)]
    pub(super) rest_speed_rad_s: f64,
    /// A frame has moved when it is displaced farther than this, beyond what its noise explains [m]
    // An object gives way by less when it is touched.
    #[arg(long, value_name = "M", default_value_t = Self::default().frame_noise_m, value_parser = positive)]
    pub(super) frame_noise_m: f64,
    /// … or rotated farther than this [rad]
    #[arg(long, value_name = "RAD", default_value_t = Self::default().frame_noise_rad, value_parser = positive)]
    pub(super) frame_noise_rad: f64,
    /// A tool that was displaced no farther than this was nudged, not moved [m] …
    #[arg(long, value_name = "M", default_value_t = Self::default().motion_min_m, value_parser = positive)]
    pub(super) motion_min_m: f64,
    /// … unless it was rotated farther than this [rad]
    #[arg(long, value_name = "RAD", default_value_t = Self::default().motion_min_rad, value_parser = positive)]
    pub(super) motion_min_rad: f64,
}

impl Default for Bounds {
    fn default() -> Self {
        Self {
            rest_s: 1.0,
            rest_window_s: 0.5,
            rest_speed_m_s: 0.01,
            rest_speed_rad_s: 0.05,
            frame_noise_m: 0.005,
            frame_noise_rad: 0.05,
            motion_min_m: 0.01,
            motion_min_rad: 0.1,
        }
    }
}

impl Bounds {
    /// Speed below which the tool rests [m/s], [rad/s].
    pub(super) fn rest_speed(&self) -> Extent {
        Extent { m: self.rest_speed_m_s, rad: self.rest_speed_rad_s }
    }

    /// How far a frame may be displaced [m], [rad].
    pub(super) fn frame(&self) -> Extent {
        Extent { m: self.frame_noise_m, rad: self.frame_noise_rad }
    }

    /// A motion goes farther than this [m], [rad].
    pub(super) fn motion_min(&self) -> Extent {
        Extent { m: self.motion_min_m, rad: self.motion_min_rad }
    }

    /// [ns].
    pub(super) fn rest_ns(&self) -> u64 {
        (self.rest_s * 1e9) as u64
    }

    /// [ns].
    pub(super) fn window_ns(&self) -> u64 {
        (self.rest_window_s.min(self.rest_s) * 1e9) as u64
    }

    /// How far the difference of two means, of so many samples each, may be from zero by noise of
    /// this standard deviation alone: k σ √(1/n₁ + 1/n₂).
    pub(super) fn explained(noise: Extent, counts: [usize; 2]) -> Extent {
        let [a, b] = counts.map(|count| 1.0 / count.max(1) as f64);
        noise.scaled(STANDARD_ERRORS * (a + b).sqrt())
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.1, 60.0, "a time from 0.1 to 60 s")
}

fn positive(text: &str) -> Result<f64, String> {
    within(text, 1e-6, 10.0, "a number from 1e-6 to 10")
}

fn within(text: &str, least: f64, most: f64, expected: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| format!("expected {expected}"))
}
