//! Rows of numbers, and files of bounded size.

use std::path::Path;

use crate::file_error::FileError;
use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;

/// Larger files are refused [bytes]: ten minutes of poses and velocities at a kilohertz have less.
const BYTES_MAX: u64 = 64 << 20;
/// Most samples of a recording, before it is resampled.
pub(super) const ROWS_MAX: usize = 600_001;
/// How far the length of a quaternion may be from one.
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// The bytes of a file that is not too large.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    tprmp_files::read(path, BYTES_MAX)
        .map_err(|source| FileError::Read { path: path.into(), source })
}

/// x, y and z if there is one.
pub(super) fn vector_of(row: &[f64]) -> DVec3 {
    DVec3::new(row[0], row[1], row.get(2).copied().unwrap_or(0.0))
}

/// The pose of 2, 3 or 7 numbers: x y [z [qw qx qy qz]], in a unit of so many metres \[m\].
pub(super) fn pose_of(row: &[f64], length_m: f64) -> Result<Pose, String> {
    let orientation = match row.get(3..7) {
        None => DQuat::IDENTITY,
        Some(q) => {
            let q = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
            let length = q.length();
            let off = (length - 1.0).abs();
            if off.is_nan() || off > QUATERNION_TOLERANCE {
                return Err(format!(
                    "expected a unit quaternion w, x, y, z, found one of length {length:.6}"
                ));
            }
            q.normalize()
        }
    };
    Ok(Pose { position: vector_of(row) * length_m, orientation })
}
