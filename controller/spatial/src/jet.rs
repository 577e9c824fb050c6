//! Truncated Taylor arithmetic of second order in time: a value with its first and second time
//! derivative. What is written once for plain numbers gives velocities and accelerations exactly.

use core::ops::{Add, Mul, Neg, Sub};
use glam::{DQuat, DVec3};

/// The arithmetic shared by plain numbers and jets.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A constant.
    fn constant(value: f64) -> Self;
    /// Its value.
    fn value(self) -> f64;
    /// self · k
    fn scaled(self, k: f64) -> Self;
    /// h(self) for a function given by its value and first two derivatives at [`Real::value`].
    fn chain(self, derivatives: [f64; 3]) -> Self;
}

impl Real for f64 {
    #[inline]
    fn constant(value: f64) -> Self {
        value
    }
    #[inline]
    fn value(self) -> f64 {
        self
    }
    #[inline]
    fn chain(self, derivatives: [f64; 3]) -> Self {
        derivatives[0]
    }
    #[inline]
    fn scaled(self, k: f64) -> Self {
        self * k
    }
}

/// u, u̇, ü.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet(
    /// u
    pub f64,
    /// u̇
    pub f64,
    /// ü
    pub f64,
);

impl Add for Jet {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1, self.2 + o.2)
    }
}

impl Sub for Jet {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1, self.2 - o.2)
    }
}

impl Neg for Jet {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0, -self.1, -self.2)
    }
}

impl Mul for Jet {
    type Output = Self;
    #[inline]
    fn mul(self, o: Self) -> Self {
        Self(
            self.0 * o.0,
            self.1 * o.0 + self.0 * o.1,
            self.2 * o.0 + 2.0 * self.1 * o.1 + self.0 * o.2,
        )
    }
}

impl Real for Jet {
    #[inline]
    fn constant(value: f64) -> Self {
        Self(value, 0.0, 0.0)
    }
    #[inline]
    fn value(self) -> f64 {
        self.0
    }
    #[inline]
    fn chain(self, [h, dh, ddh]: [f64; 3]) -> Self {
        Self(h, dh * self.1, ddh * self.1 * self.1 + dh * self.2)
    }
    #[inline]
    fn scaled(self, k: f64) -> Self {
        Self(self.0 * k, self.1 * k, self.2 * k)
    }
}

/// A vector of three reals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vec3<S>(pub [S; 3]);

impl<S: Real> Vec3<S> {
    /// A constant vector.
    #[inline]
    pub fn constant(v: DVec3) -> Self {
        Self(v.to_array().map(S::constant))
    }
    /// self + v
    #[inline]
    pub fn plus(self, v: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, v.0);
        Self([a + x, b + y, c + z])
    }
    /// self − v
    #[inline]
    pub fn minus(self, v: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, v.0);
        Self([a - x, b - y, c - z])
    }
    /// s · self
    #[inline]
    pub fn times(self, s: S) -> Self {
        let [a, b, c] = self.0;
        Self([a * s, b * s, c * s])
    }
    /// self · v
    #[inline]
    pub fn dot(self, v: Self) -> S {
        self.0[0] * v.0[0] + self.0[1] * v.0[1] + self.0[2] * v.0[2]
    }
    /// self × v
    #[inline]
    pub fn cross(self, v: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, v.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }
}

impl<S: Real> Vec3<S> {
    /// Its value.
    #[must_use]
    #[inline]
    pub fn value(self) -> DVec3 {
        let [x, y, z] = self.0;
        DVec3::new(x.value(), y.value(), z.value())
    }
}

impl Vec3<Jet> {
    /// A point that moves: value, velocity, acceleration.
    #[must_use]
    #[inline]
    pub fn moving(v: DVec3, velocity: DVec3, acceleration: DVec3) -> Self {
        let jet = |i: usize| Jet(v[i], velocity[i], acceleration[i]);
        Self([jet(0), jet(1), jet(2)])
    }
    /// First time derivative.
    #[must_use]
    #[inline]
    pub fn first(self) -> DVec3 {
        let [x, y, z] = self.0;
        DVec3::new(x.1, y.1, z.1)
    }
    /// Second time derivative.
    #[must_use]
    #[inline]
    pub fn second(self) -> DVec3 {
        let [x, y, z] = self.0;
        DVec3::new(x.2, y.2, z.2)
    }
}

/// A quaternion of reals: scalar part `w`, vector part `v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quat<S> {
    /// Scalar part.
    pub w: S,
    /// Vector part.
    pub v: Vec3<S>,
}

/// sin(θ/2)/θ and its first two derivatives with respect to s = θ²; cos(θ/2) likewise.
#[inline]
fn half_angle_functions(s: f64) -> ([f64; 3], [f64; 3]) {
    if s < 1e-3 {
        // Taylor series: truncation below 1e-16 for s < 1e-3.
        let sinc = [
            0.5 - s / 48.0 + s * s / 3840.0 - s * s * s / 645_120.0,
            -1.0 / 48.0 + s / 1920.0 - s * s / 215_040.0,
            1.0 / 1920.0 - s / 107_520.0 + s * s / 10_321_920.0,
        ];
        let cos = [
            1.0 - s / 8.0 + s * s / 384.0 - s * s * s / 46_080.0,
            -1.0 / 8.0 + s / 192.0 - s * s / 15_360.0,
            1.0 / 192.0 - s / 7680.0 + s * s / 860_160.0,
        ];
        return (sinc, cos);
    }
    let theta = s.sqrt();
    let (sin, cos) = (0.5 * theta).sin_cos();
    let sinc = sin / theta;
    let sinc1 = (0.25 * cos - 0.5 * sinc) / s;
    let sinc2 = (-sinc / 16.0 - 1.5 * sinc1) / s;
    let cos1 = -0.25 * sinc;
    ([sinc, sinc1, sinc2], [cos, cos1, -0.25 * sinc1])
}

impl<S: Real> Quat<S> {
    /// A constant quaternion.
    #[inline]
    pub fn constant(q: DQuat) -> Self {
        Self { w: S::constant(q.w), v: Vec3::constant(q.xyz()) }
    }

    /// The rotation by the angle |r| about r.
    #[inline]
    pub fn exp(r: Vec3<S>) -> Self {
        let s = r.dot(r);
        let (sinc, cos) = half_angle_functions(s.value());
        Self { w: s.chain(cos), v: r.times(s.chain(sinc)) }
    }

    /// Its value.
    #[must_use]
    #[inline]
    pub fn value(self) -> DQuat {
        let [x, y, z] = self.v.0.map(Real::value);
        DQuat::from_xyzw(x, y, z, self.w.value())
    }

    /// The Hamilton product self ⊗ q.
    #[inline]
    pub fn times(self, q: Self) -> Self {
        Self {
            w: self.w * q.w - self.v.dot(q.v),
            v: q.v.times(self.w).plus(self.v.times(q.w)).plus(self.v.cross(q.v)),
        }
    }

    /// The Hamilton product q ⊗ self with a constant q.
    #[inline]
    pub fn times_constant_left(self, q: DQuat) -> Self {
        let by = |c: S, k: f64| c.scaled(k);
        let (w, [x, y, z]) = (self.w, self.v.0);
        Self {
            w: by(w, q.w) - by(x, q.x) - by(y, q.y) - by(z, q.z),
            v: Vec3([
                by(w, q.x) + by(x, q.w) + by(z, q.y) - by(y, q.z),
                by(w, q.y) + by(y, q.w) + by(x, q.z) - by(z, q.x),
                by(w, q.z) + by(z, q.w) + by(y, q.x) - by(x, q.y),
            ]),
        }
    }

    /// The inverse of a unit quaternion.
    #[inline]
    pub fn conjugate(self) -> Self {
        let [x, y, z] = self.v.0;
        Self { w: self.w, v: Vec3([-x, -y, -z]) }
    }

    /// The vector r, rotated.
    #[inline]
    pub fn rotate(self, r: Vec3<S>) -> Vec3<S> {
        let t = self.v.cross(r);
        let t = t.plus(t);
        r.plus(t.times(self.w)).plus(self.v.cross(t))
    }

    /// The rotation vector of the smaller of both angles, |r| ≤ π. Inverse to [`Quat::exp`].
    #[inline]
    pub fn log(self) -> Vec3<S> {
        let [x, y, z] = self.v.0;
        let (w, v) =
            if self.w.value() < 0.0 { (-self.w, Vec3([-x, -y, -z])) } else { (self.w, self.v) };
        // θ/sin(θ/2) as a function of c = cos(θ/2): 2 arccos(c)/√(1−c²).
        let squared = v.value().length_squared();
        v.times(w.chain(angle_over_sine(w.value(), squared)))
    }
}

/// 2 arccos(c)/√(1−c²) and its first two derivatives with respect to c, where n2 = 1−c² is given
/// separately so that nothing cancels.
#[inline]
fn angle_over_sine(c: f64, n2: f64) -> [f64; 3] {
    // h = 2 arccos(c)/√(1−c²) solves (1−c²) h′ = c h − 2.
    if n2 < 1e-4 {
        // Series in e = 1−c: h = 2 (1 + e/3 + 2e²/15 + 2e³/35 + …).
        let e = n2 / (1.0 + c);
        let h = 2.0 + e * (2.0 / 3.0 + e * (4.0 / 15.0 + e * (4.0 / 35.0)));
        let h1 = -(2.0 / 3.0 + e * (8.0 / 15.0 + e * (12.0 / 35.0)));
        let h2 = 8.0 / 15.0 + e * (24.0 / 35.0);
        return [h, h1, h2];
    }
    let n = n2.sqrt();
    let h = 2.0 * n.atan2(c) / n;
    let h1 = (c * h - 2.0) / n2;
    let h2 = (h + 3.0 * c * h1) / n2;
    [h, h1, h2]
}

impl Quat<Jet> {
    /// A frame that rotates: orientation, angular velocity and acceleration in the frame in which
    /// the orientation is expressed: q̇ = ½ ω q, q̈ = ½ ω̇ q − ¼ |ω|² q.
    #[must_use]
    #[inline]
    pub fn moving(q: DQuat, angular_velocity: DVec3, angular_acceleration: DVec3) -> Self {
        let product = |r: DVec3| DQuat::from_xyzw(r.x, r.y, r.z, 0.0) * q;
        let first = product(angular_velocity) * 0.5;
        let second =
            product(angular_acceleration) * 0.5 + q * (-0.25 * angular_velocity.length_squared());
        let jet = |i: usize| Jet(q.to_array()[i], first.to_array()[i], second.to_array()[i]);
        Self { w: jet(3), v: Vec3([jet(0), jet(1), jet(2)]) }
    }

    /// Angular velocity and acceleration: ω = 2 q̇ q⁻¹, ω̇ = 2 q̈ q⁻¹ + ½ |ω|² (vector parts).
    #[must_use]
    #[inline]
    pub fn angular_motion(self) -> (DVec3, DVec3) {
        let part = |f: fn(Jet) -> f64| {
            DQuat::from_xyzw(f(self.v.0[0]), f(self.v.0[1]), f(self.v.0[2]), f(self.w))
        };
        let inverse = part(|c| c.0).conjugate();
        let motion = |q: DQuat| (q * inverse).xyz() * 2.0;
        (motion(part(|c| c.1)), motion(part(|c| c.2)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A curve of rotation vectors.
    fn curve(t: f64) -> DVec3 {
        DVec3::new(0.9 * (1.3 * t).sin() + 0.4, 0.5 * t, -0.8 * (0.7 * t).cos())
    }

    fn jets(t: f64) -> Vec3<Jet> {
        let h = 1e-4;
        let first = (curve(t + h) - curve(t - h)) / (2.0 * h);
        let second = (curve(t + h) - 2.0 * curve(t) + curve(t - h)) / (h * h);
        Vec3::moving(curve(t), first, second)
    }

    fn plain(v: DVec3) -> Vec3<f64> {
        Vec3(v.to_array())
    }

    #[test]
    fn log_is_inverse_to_exp_on_both_hemispheres() {
        for r in [
            DVec3::ZERO,
            DVec3::new(1e-9, 0.0, 0.0),
            DVec3::new(1e-3, -2e-3, 5e-4),
            DVec3::new(0.02, 0.01, 0.0),
            DVec3::new(0.3, -1.0, 0.2),
            DVec3::new(0.0, 3.1, 0.2),
        ] {
            let q = Quat::exp(plain(r));
            let negated = Quat { w: -q.w, v: q.v.times(-1.0) };
            for q in [q, negated] {
                let back = DVec3::from_array(q.log().0);
                assert!((back - r).length() < 1e-12, "{r} {back}");
            }
            let expected = DQuat::from_scaled_axis(r);
            assert!(
                (DQuat::from_xyzw(q.v.0[0], q.v.0[1], q.v.0[2], q.w) - expected).length() < 1e-14
            );
        }
    }

    #[test]
    fn jets_are_derivatives_of_exp_log_and_rotation() {
        let fixed = DQuat::from_scaled_axis(DVec3::new(-0.4, 0.3, 0.9));
        let point = DVec3::new(0.2, -0.5, 1.1);
        let path = |t: f64| {
            let q = Quat::exp(plain(curve(t))).times(Quat::constant(fixed));
            (DVec3::from_array(q.rotate(plain(point)).0), DVec3::from_array(q.log().0))
        };
        for t in [-0.8, -0.444, 0.1, 0.7] {
            let q = Quat::exp(jets(t)).times(Quat::constant(fixed));
            let rotated = q.rotate(Vec3::constant(point));
            let log = q.log();
            let h = 1e-4;
            let (a, b, c) = (path(t - h), path(t), path(t + h));
            for (jet, [a, b, c]) in [(rotated, [a.0, b.0, c.0]), (log, [a.1, b.1, c.1])] {
                assert!((jet.first() - (c - a) / (2.0 * h)).length() < 1e-6);
                assert!((jet.second() - (c - 2.0 * b + a) / (h * h)).length() < 1e-5);
            }
        }
    }

    #[test]
    fn series_and_closed_forms_meet() {
        let (a, b) = (half_angle_functions(1e-3 - 1e-12), half_angle_functions(1e-3));
        for i in 0..3 {
            assert!((a.0[i] - b.0[i]).abs() < 1e-9 && (a.1[i] - b.1[i]).abs() < 1e-9, "{i}");
        }
        let at = |n2: f64| angle_over_sine((1.0 - n2).sqrt(), n2);
        let (a, b) = (at(1e-4 - 1e-14), at(1e-4));
        for i in 0..3 {
            assert!((a[i] - b[i]).abs() < 1e-6, "{i} {} {}", a[i], b[i]);
        }
    }

    #[test]
    fn angular_motion_returns_what_moving_was_given() {
        let (omega, alpha) = (DVec3::new(0.3, -1.2, 0.5), DVec3::new(-2.0, 0.1, 0.7));
        let q = Quat::moving(DQuat::from_scaled_axis(DVec3::new(1.0, 0.2, -0.5)), omega, alpha);
        let (first, second) = q.angular_motion();
        assert!((first - omega).length() < 1e-14 && (second - alpha).length() < 1e-14);
        assert!((q.times(q.conjugate()).w.2).abs() < 1e-14, "unit length is kept");
    }
}
