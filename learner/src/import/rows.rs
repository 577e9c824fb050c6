//! Rows of numbers, and files of bounded size.

use std::path::Path;

use crate::file_error::FileError;
use glam::{DQuat, DVec3};
use tprmp_spatial::Pose;

/// Larger files, and larger contents of compressed ones, are refused [bytes].
pub(super) const BYTES_MAX: u64 = 256 << 20;
/// How far the length of a quaternion may be from one.
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// The bytes of a file that is not too large.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let unreadable = |source| FileError::Read { path: path.into(), source };
    let size = std::fs::metadata(path).map_err(unreadable)?.len();
    if size > BYTES_MAX {
        let problem = format!("expected at most {BYTES_MAX} bytes, found {size}");
        return Err(FileError::input(path, "size", problem));
    }
    std::fs::read(path).map_err(unreadable)
}

/// x, y and z if there is one.
pub(super) fn vector_of(row: &[f64]) -> DVec3 {
    DVec3::new(row[0], row[1], row.get(2).copied().unwrap_or(0.0))
}

/// The pose of 2, 3 or 7 numbers: x y [z [qw qx qy qz]].
pub(super) fn pose_of(row: &[f64]) -> Result<Pose, String> {
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
    Ok(Pose { position: vector_of(row), orientation })
}
