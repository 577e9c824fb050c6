//! What was asked of the loop from outside: set by other threads, taken by the loop at the beginning of a tick.
//! No lock, no allocation.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};

/// A gain that can be changed while the loop runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// `skill.governor.linear_max_m_s`
    LinearMax,
    /// `skill.governor.angular_max_rad_s`
    AngularMax,
    /// `impedance.natural_frequency_rad_s`
    NaturalFrequency,
    /// `impedance.damping_ratio`
    DampingRatio,
    /// `robot.point_limits.speed_max_m_s`
    PointSpeedMax,
}

impl Setting {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::LinearMax,
        Self::AngularMax,
        Self::NaturalFrequency,
        Self::DampingRatio,
        Self::PointSpeedMax,
    ];

    /// Its key in the configuration.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::LinearMax => "skill.governor.linear_max_m_s",
            Self::AngularMax => "skill.governor.angular_max_rad_s",
            Self::NaturalFrequency => "impedance.natural_frequency_rad_s",
            Self::DampingRatio => "impedance.damping_ratio",
            Self::PointSpeedMax => "robot.point_limits.speed_max_m_s",
        }
    }

    /// The one of this key.
    #[must_use]
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|setting| setting.key() == key)
    }
}

const NOTHING: u8 = 0;
const START: u8 = 1;
const HOLD: u8 = 2;

/// Requests that the loop has not taken yet.
#[derive(Debug)]
pub struct Requests {
    /// The last one counts.
    go: AtomicU8,
    reset: AtomicBool,
    /// Values as bits, NaN where none was set.
    settings: [AtomicU64; Setting::ALL.len()],
}

impl Default for Requests {
    fn default() -> Self {
        Self {
            go: AtomicU8::new(NOTHING),
            reset: AtomicBool::new(false),
            settings: [const { AtomicU64::new(f64::NAN.to_bits()) }; Setting::ALL.len()],
        }
    }
}

impl Requests {
    /// Go on.
    pub fn start(&self) {
        self.go.store(START, Ordering::Relaxed);
    }

    /// Hold.
    pub fn hold(&self) {
        self.go.store(HOLD, Ordering::Relaxed);
    }

    /// Forget the fault.
    pub fn reset(&self) {
        self.reset.store(true, Ordering::Relaxed);
    }

    /// Change a setting to `value`, in its unit.
    pub fn set(&self, setting: Setting, value: f64) {
        self.settings[setting as usize].store(value.to_bits(), Ordering::Relaxed);
    }

    /// Whether a start (`true`) or a hold was asked for, once; the last of both.
    pub fn take_go(&self) -> Option<bool> {
        match self.go.swap(NOTHING, Ordering::Relaxed) {
            START => Some(true),
            HOLD => Some(false),
            _ => None,
        }
    }

    /// Whether a reset was asked for, once.
    pub fn take_reset(&self) -> bool {
        self.reset.swap(false, Ordering::Relaxed)
    }

    /// What a setting is to be changed to, `None` where that was never asked for.
    #[must_use]
    pub fn setting(&self, setting: Setting) -> Option<f64> {
        let value = f64::from_bits(self.settings[setting as usize].load(Ordering::Relaxed));
        value.is_finite().then_some(value)
    }
}
