//! Triangles of what the mesh loader reads.

use std::io;

use glam::DVec3;
use mesh_loader::Scene;

use crate::triangle::Triangle;

/// All triangles of a scene. Each mesh numbers its own vertices.
pub(crate) fn of_scene(scene: io::Result<Scene>) -> Result<Vec<Triangle>, String> {
    let mut triangles = Vec::new();
    for mesh in scene.map_err(|error| error.to_string())?.meshes {
        for face in &mesh.faces {
            let corner = |index: u32| mesh.vertices.get(index as usize);
            let [Some(a), Some(b), Some(c)] = face.map(corner) else {
                return Err(format!(
                    "expected one of {} vertices, found {face:?}",
                    mesh.vertices.len()
                ));
            };
            triangles.push([a, b, c].map(|&v| DVec3::from_array(v.map(f64::from))));
        }
    }
    Ok(triangles)
}
