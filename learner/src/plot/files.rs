//! Writes the pictures of a model and their page.

use std::path::{Path, PathBuf};

use tprmp_drawing::Page;
use tprmp_files::{Existing, make_folder};
use tprmp_model::skill_model::{self, ModelError, Motion, SkillModel, sha256_hex};

use super::figures;
use super::gallery::{frame_of, gallery, modes};
use crate::demonstration::{self, Demonstration};
use crate::file_error::FileError;
use crate::mixture::components::Choice;

/// Why nothing is drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The demonstrations, or the folder of pictures.
    #[error(transparent)]
    File(#[from] FileError),
    /// The model file.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Draws a model into a folder, which is made when it is missing. Returns the files: pictures, and
/// last the page that shows them all. The same input gives the same bytes.
///
/// # Errors
/// [`PlotError`]: the model is refused, `demonstrations` lacks a file that the model was learned
/// from or holds another version of it, or the folder cannot be written.
pub fn plot(model: &Path, demonstrations: &Path, out: &Path) -> Result<Vec<PathBuf>, PlotError> {
    let file = model;
    let model = skill_model::read(file)?;
    let mut read = Vec::new();
    for mode in model.modes() {
        read.push(read_demonstrations(mode, demonstrations)?);
    }
    let mut pictures = Vec::new();
    if read.len() > 1 {
        pictures.push(modes(&model, &read));
    }
    for (i, (mode, demonstrations)) in model.modes().zip(&read).enumerate() {
        let mut of_mode = gallery(mode, demonstrations)
            .map_err(|error| FileError::key(file, "policy", error.to_string()))?;
        if i > 0 {
            for picture in &mut of_mode {
                picture.name = format!("mode-{}-{}", i + 1, picture.name);
                picture.caption = format!("Mode {}. {}", i + 1, picture.caption);
            }
        }
        pictures.extend(of_mode);
    }

    let write = |name: &str, text: &str| {
        let path = out.join(name);
        // Drawn anew: pictures are no record of anything.
        tprmp_files::write(&path, text, Existing::Replace)?;
        Ok::<_, FileError>(path)
    };
    make_folder(out).map_err(FileError::from)?;
    let mut paths = Vec::with_capacity(pictures.len() + 1);
    for picture in &pictures {
        paths.push(write(&format!("{}.svg", picture.name), &picture.svg)?);
    }
    let mut page = page_head(&model);
    page.pictures(&pictures);
    paths.push(write("index.html", &page.html())?);
    Ok(paths)
}

/// The choice of the number of Gaussians as an SVG document.
pub fn choice(choice: &Choice) -> String {
    figures::choice(choice).svg()
}

/// Reads the demonstrations a model was learned from.
fn read_demonstrations(model: &SkillModel, folder: &Path) -> Result<Vec<Demonstration>, FileError> {
    let read = |source: &skill_model::Source| {
        let path = folder.join(&source.file);
        let fail = |problem: String| FileError::Input {
            path: path.clone(),
            place: format!("from which the model `{}` was learned", model.skill),
            problem,
        };
        if !path.is_file() {
            return Err(fail("expected this file, found none".into()));
        }
        let bytes = tprmp_files::read(&path, demonstration::BYTES_MAX)
            .map_err(|source| FileError::Read { path: path.clone(), source })?;
        let found = sha256_hex(&bytes);
        if found != source.sha256 {
            let expected = &source.sha256;
            return Err(fail(format!(
                "expected the SHA-256 {expected}, found {found}: it is not the file the model was \
                 learned from, or it has changed since"
            )));
        }
        let read = demonstration::read(&path, &model.start_frame, &model.goal_frame)?;
        match model.frames.iter().find(|frame| frame_of(model, &read, &frame.name).is_none()) {
            Some(frame) => Err(fail(format!("expected a frame `{}`, found none", frame.name))),
            None => Ok(read),
        }
    };
    let sources = &model.provenance.demonstrations;
    let mut demonstrations = sources.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let ends = [model.start_frame.as_str(), &model.goal_frame];
    demonstration::leave_part(&mut demonstrations, model.manifold, folder, ends)?;
    Ok(demonstrations)
}

/// What the page says before its pictures.
fn page_head(model: &SkillModel) -> Page {
    let mut page = Page::new(&format!("Skill “{}”", model.skill));
    page.paragraph(&format!(
        "{manifold}, {way}; {count} demonstrations, K = {components} Gaussians; learned by version \
         {version}, seed {seed}.",
        manifold = model.manifold,
        way = match model.motion {
            Motion::Discrete =>
                format!("from “{}” to a goal fixed to “{}”", model.start_frame, model.goal_frame),
            Motion::Periodic { .. } => format!("round for ever, fixed to “{}”", model.goal_frame),
        },
        count = model.modes().map(|mode| mode.provenance.demonstrations.len()).sum::<usize>(),
        components = model.gaussians.len(),
        version = model.provenance.tool_version,
        seed = model.provenance.seed,
    ));
    if let Some(told) = model.cycle_line() {
        page.paragraph(&format!("It has a limit cycle in place of a goal: {told}."));
    }
    let count = model.modes().len();
    if count > 1 {
        page.paragraph(&format!(
            "The demonstrations show {count} ways of doing it: the model carries a mode for each, and the \
             controller decides on one when it starts."
        ));
    }
    let failures = &model.failures();
    let holds = failures.is_empty();
    page.verdict(
        Some(holds),
        if holds { "Its certificate holds." } else { "Its certificate fails:" },
    );
    page.list(failures);
    page
}
