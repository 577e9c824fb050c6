//! Twists, accelerations and wrenches: pairs of a linear and an angular vector.

use core::ops::{Add, Mul, Neg, Sub};

use glam::DVec3;
use nalgebra::Vector6;

use crate::pose::Pose;

/// Defines a pair of vectors with the arithmetic of a six-dimensional vector space.
macro_rules! six_vector {
    ($(#[$meta:meta])* $name:ident { $(#[$first_meta:meta])* $first:ident, $(#[$second_meta:meta])* $second:ident }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name {
            $(#[$first_meta])*
            pub $first: DVec3,
            $(#[$second_meta])*
            pub $second: DVec3,
        }

        impl $name {
            /// Zero.
            pub const ZERO: Self = Self { $first: DVec3::ZERO, $second: DVec3::ZERO };
            /// Not yet known: every number is NaN.
            pub const UNDEFINED: Self = Self { $first: DVec3::NAN, $second: DVec3::NAN };

            /// Whether every number of it is finite.
            #[must_use]
            #[inline]
            pub fn is_finite(&self) -> bool {
                self.$first.is_finite() && self.$second.is_finite()
            }
        }

        impl Add for $name {
            type Output = Self;
            #[inline]
            fn add(self, other: Self) -> Self {
                Self { $first: self.$first + other.$first, $second: self.$second + other.$second }
            }
        }

        impl Sub for $name {
            type Output = Self;
            #[inline]
            fn sub(self, other: Self) -> Self {
                Self { $first: self.$first - other.$first, $second: self.$second - other.$second }
            }
        }

        impl Neg for $name {
            type Output = Self;
            #[inline]
            fn neg(self) -> Self {
                Self { $first: -self.$first, $second: -self.$second }
            }
        }

        impl Mul<f64> for $name {
            type Output = Self;
            #[inline]
            fn mul(self, factor: f64) -> Self {
                Self { $first: self.$first * factor, $second: self.$second * factor }
            }
        }

        impl From<$name> for Vector6<f64> {
            #[inline]
            fn from(v: $name) -> Self {
                let (a, b) = (v.$first, v.$second);
                Self::new(a.x, a.y, a.z, b.x, b.y, b.z)
            }
        }

        impl From<Vector6<f64>> for $name {
            #[inline]
            fn from(v: Vector6<f64>) -> Self {
                Self {
                    $first: DVec3::new(v[0], v[1], v[2]),
                    $second: DVec3::new(v[3], v[4], v[5]),
                }
            }
        }
    };
}

six_vector!(
    /// V_AB: how frame B moves in frame A, expressed in A.
    Twist {
        /// Velocity of B's origin \[m/s\].
        linear,
        /// ω_AB \[rad/s\].
        angular
    }
);

six_vector!(
    /// A_AB: the time derivative of a [`Twist`], expressed in A, as in Drake: the linear part is the
    /// acceleration of B's origin, not Featherstone's.
    SpatialAcceleration {
        /// Acceleration of B's origin \[m/s²\].
        linear,
        /// Angular acceleration \[rad/s²\].
        angular
    }
);

six_vector!(
    /// F_B: a force and a torque about B's origin; the dual of a [`Twist`].
    Wrench {
        /// \[N\]
        force,
        /// \[N m\]
        torque
    }
);

impl Twist {
    /// The velocity after `dt_s` \[s\] with an acceleration: V + A dt.
    #[inline]
    #[must_use]
    pub fn advanced(&self, acceleration: &SpatialAcceleration, dt_s: f64) -> Self {
        Self {
            linear: self.linear + acceleration.linear * dt_s,
            angular: self.angular + acceleration.angular * dt_s,
        }
    }

    /// V_AC of a frame C that is fixed to B, its origin `r` from B's \[m\], expressed in A:
    /// v_C = v_B + ω × r.
    #[inline]
    #[must_use]
    pub fn shifted(&self, r: DVec3) -> Self {
        Self { linear: self.linear + self.angular.cross(r), angular: self.angular }
    }

    /// The adjoint of a pose, Ad(X): the twist of a body in the axes and at the origin of frame A, where
    /// `self` is that in the axes and at the origin of frame B, and X = X_AB:  ω_A = R ω,  v_A = R v + p × R ω.
    #[inline]
    #[must_use]
    pub fn adjoint(&self, x: &Pose) -> Self {
        let angular = x.orientation * self.angular;
        Self { linear: x.orientation * self.linear + x.position.cross(angular), angular }
    }

    /// Power of a wrench at the same point \[W\].
    #[inline]
    #[must_use]
    pub fn power(&self, wrench: &Wrench) -> f64 {
        self.linear.dot(wrench.force) + self.angular.dot(wrench.torque)
    }
}

impl SpatialAcceleration {
    /// A_AC of a frame C that is fixed to B, its origin `r` from B's \[m\], expressed in A:
    /// a_C = a_B + α × r + ω × (ω × r).
    ///
    /// * `angular`  ω_AB \[rad/s\]
    #[inline]
    #[must_use]
    pub fn shifted(&self, angular: DVec3, r: DVec3) -> Self {
        let linear = self.linear + self.angular.cross(r) + angular.cross(angular.cross(r));
        Self { linear, angular: self.angular }
    }
}

impl Wrench {
    /// The same wrench about a point `r` from B's origin \[m\]: τ_C = τ_B − r × f.
    #[inline]
    #[must_use]
    pub fn shifted(&self, r: DVec3) -> Self {
        Self { force: self.force, torque: self.torque - r.cross(self.force) }
    }
}
