//! Colours and strokes of policies.

use glam::DVec2;
use tprmp_drawing::{BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED, Sign, Stroke};

use crate::experiment::PolicyKind;

/// Of what was published.
pub(crate) const INK_DOT: &str = BLACK;
/// A mark on the axes.
pub(crate) const MARK: Stroke = Stroke::dashed(GREY, 1.2);
/// Size of the axes [px].
pub(crate) const SIZE: DVec2 = DVec2::new(470.0, 300.0);

/// Colour of a policy.
pub(crate) fn colour(policy: PolicyKind) -> &'static str {
    match policy {
        PolicyKind::Canonical => BLUE,
        PolicyKind::Thesis => RED,
        PolicyKind::Pd => GREEN,
        PolicyKind::PdPublished => GREY,
        PolicyKind::Dmp => ORANGE,
        PolicyKind::TpgmmLqr => PURPLE,
    }
}

/// The legend of these policies.
pub(crate) fn legend(policies: &[PolicyKind]) -> Vec<(String, Sign)> {
    let sign = |p: &PolicyKind| (p.words(), Sign::Line(Stroke::solid(colour(*p), 3.0)));
    policies.iter().map(sign).collect()
}
