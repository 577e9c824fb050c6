//! Where a mesh is that a URDF names.

use std::path::{Path, PathBuf};

use crate::mesh::MeshFault;

/// Folders of packages: what `package://NAME/…` and `model://NAME/…` mean.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Packages {
    /// Names with their folders; the first that has the file counts.
    pub named: Vec<(String, PathBuf)>,
    /// Folders that hold packages, each in a folder of its name: `ROS_PACKAGE_PATH`.
    pub roots: Vec<PathBuf>,
}

impl Packages {
    /// Names with their folders, and what the environment's `ROS_PACKAGE_PATH` lists.
    #[must_use]
    pub fn with_environment(named: Vec<(String, PathBuf)>) -> Self {
        let paths = std::env::var_os("ROS_PACKAGE_PATH").unwrap_or_default();
        Self {
            named,
            roots: std::env::split_paths(&paths).filter(|path| path.is_absolute()).collect(),
        }
    }

    /// The file that `filename` names in the URDF of a folder.
    ///
    /// A package is looked for by its name, then in the roots, then among the folders above the URDF: one of that
    /// name, the nearest first, or else a child of that name. Other names are relative to the folder of the URDF.
    pub(crate) fn resolve(&self, folder: &Path, filename: &str) -> Result<PathBuf, MeshFault> {
        let (package, candidates) = self.candidates(folder, filename);
        if let Some(found) = candidates.iter().find(|path| path.is_file()) {
            return Ok(found.clone());
        }
        if let Some(path) = candidates.iter().find(|path| path.exists()) {
            return Err(MeshFault::NotAMesh(format!(
                "expected a file, found a folder: `{}`",
                path.display()
            )));
        }
        let remedy = match package {
            Some(name) => format!("say where package `{name}` is: --package {name}=FOLDER"),
            None => "put the mesh there, or correct the file name".into(),
        };
        // The last folders above say nothing new.
        let looked_at = candidates.iter().take(6).map(|path| path.display().to_string()).collect();
        Err(MeshFault::NotFound { looked_at, remedy })
    }

    /// Where the file can be, the likeliest first, and the name of its package.
    fn candidates<'a>(&self, folder: &Path, filename: &'a str) -> (Option<&'a str>, Vec<PathBuf>) {
        if let Some(path) = file_url(filename) {
            // What is escaped is meant as a character, unless a file is named so.
            let plain = unescaped(path).map(|path| folder.join(path));
            return (None, plain.into_iter().chain([folder.join(path)]).collect());
        }
        let inside =
            filename.strip_prefix("package://").or_else(|| filename.strip_prefix("model://"));
        let Some((name, path)) =
            inside.map(|inside| inside.split_once('/').unwrap_or((inside, "")))
        else {
            return (None, vec![folder.join(filename)]);
        };
        let mut folders: Vec<PathBuf> = self
            .named
            .iter()
            .filter(|(named, _)| named == name)
            .map(|(_, folder)| folder.clone())
            .collect();
        for root in &self.roots {
            folders.push(root.join(name));
            folders.extend((root.file_name() == Some(name.as_ref())).then(|| root.clone()));
        }
        let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        let is_it = |above: &&Path| above.file_name() == Some(name.as_ref());
        folders.extend(absolute.ancestors().filter(is_it).map(Path::to_owned));
        folders.extend(absolute.ancestors().map(|above| above.join(name)));
        (Some(name), folders.into_iter().map(|folder| folder.join(path)).collect())
    }
}

/// The path of a URL of a file on this machine.
fn file_url(name: &str) -> Option<&str> {
    let rest = name.strip_prefix("file:")?;
    match rest.strip_prefix("//") {
        // The host may be named.
        Some(path) => {
            Some(path.strip_prefix("localhost").filter(|p| p.starts_with('/')).unwrap_or(path))
        }
        None => rest.starts_with('/').then_some(rest),
    }
}

/// A path with its escapes, as `%20`, read as the bytes they stand for; `None` where there are none.
fn unescaped(path: &str) -> Option<String> {
    let mut parts = path.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    let mut is_changed = false;
    for part in parts {
        let digits = part.get(..2).filter(|two| two.bytes().all(|byte| byte.is_ascii_hexdigit()));
        match digits.and_then(|two| u8::from_str_radix(two, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                bytes.extend(part.bytes().skip(2));
                is_changed = true;
            }
            None => bytes.extend([b"%", part.as_bytes()].concat()),
        }
    }
    is_changed.then(|| String::from_utf8(bytes).ok()).flatten()
}
