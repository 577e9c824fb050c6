//! The rules a model obeys.

use nalgebra::DMatrix;
use tprmp_rmpflow::policy::FRAME_CAPACITY;
use tprmp_rmpflow::policy::canonical::adaptation::SPLINES;
use tprmp_rmpflow::policy::canonical::field::COMPONENT_CAPACITY;
use tprmp_rmpflow::policy::canonical::frame_map::PHASE_DISTANCE_MIN;

use crate::skill_model::certificate::{Certificate, Rollouts};
use crate::skill_model::gripper::{GripperAction, GripperEvent};
use crate::skill_model::model::{
    Component, FieldModel, Gaussian, MODE_CAPACITY, Manifold, PolicyModel, Pose, SkillModel,
    ThesisModel,
};

/// A key of the body, and what is wrong with its value.
type Violation = (String, String);

/// Relative tolerance of symmetry, of the goal's identity metric and of unit quaternions.
const TOLERANCE: f64 = 1e-9;
/// No number of a learned model is near it; products and squares of such stay finite.
const NUMBER_MAX: f64 = 1e15;

/// Most events of the gripper: a skill that has more is several.
pub const GRIPPER_EVENTS_MAX: usize = 64;

/// Refuses what is no [`tprmp_files::Name`]: it becomes part of file names and pages.
fn name(key: &str, text: &str) -> Result<(), Violation> {
    tprmp_files::name::check(text).map_err(|error| (key.into(), error.to_string()))
}

impl SkillModel {
    /// Checks every rule of the model: dimensions, finiteness, definiteness, unit quaternions.
    pub(super) fn validate(&self) -> Result<(), Violation> {
        for (key, name) in [
            ("skill", &self.skill),
            ("tool_frame", &self.tool_frame),
            ("start_frame", &self.start_frame),
            ("goal_frame", &self.goal_frame),
        ] {
            self::name(key, name)?;
        }
        for (i, source) in self.provenance.demonstrations.iter().enumerate() {
            name(&format!("provenance.demonstrations[{i}].file"), &source.file)?;
        }
        let canonical = &self.canonical;
        pose("canonical.start", &canonical.start)?;
        pose("canonical.goal_frame", &canonical.goal_frame)?;
        pose("canonical.goal", &canonical.goal)?;
        require(!self.gaussians.is_empty(), "gaussians", || "expected at least one".into())?;
        for (k, g) in self.gaussians.iter().enumerate() {
            gaussian(&format!("gaussians[{k}]"), g, self.manifold.dimension())?;
        }
        self.validate_frames()?;
        self.validate_waypoints()?;
        self.validate_adaptation()?;
        self.validate_motion()?;
        match &self.policy {
            PolicyModel::Canonical { position, orientation } => {
                self.validate_canonical(position, orientation.as_ref())?;
            }
            PolicyModel::Thesis(policy) => self.validate_thesis(policy)?,
        }
        self.validate_gripper()?;
        finite("fit.em_log_likelihood", &[self.fit.em_log_likelihood])?;
        self.validate_certificate()?;
        self.validate_modes()
    }

    /// Other modes obey the same rules, and are of the same skill.
    fn validate_modes(&self) -> Result<(), Violation> {
        let others = &self.other_modes;
        require(others.len() < MODE_CAPACITY, "other_modes", || {
            format!("expected at most {}, found {}", MODE_CAPACITY - 1, others.len())
        })?;
        let frames =
            |of: &Self| of.frames.iter().map(|frame| frame.name.clone()).collect::<Vec<_>>();
        for (i, mode) in others.iter().enumerate() {
            let key = format!("other_modes[{i}]");
            require(mode.other_modes.is_empty(), format!("{key}.other_modes"), || {
                "expected none, found some".into()
            })?;
            mode.validate().map_err(|(inner, problem)| (format!("{key}.{inner}"), problem))?;
            for (of, expected, found) in [
                ("skill", &self.skill, &mode.skill),
                ("tool_frame", &self.tool_frame, &mode.tool_frame),
                ("start_frame", &self.start_frame, &mode.start_frame),
                ("goal_frame", &self.goal_frame, &mode.goal_frame),
                ("manifold", &self.manifold.to_string(), &mode.manifold.to_string()),
                ("frames", &frames(self).join(", "), &frames(mode).join(", ")),
            ] {
                require(expected == found, format!("{key}.{of}"), || {
                    format!("expected `{expected}` as in the first mode, found `{found}`")
                })?;
            }
            let same = |of: &&Self| of.canonical == mode.canonical && of.policy == mode.policy;
            let twice = std::iter::once(self).chain(&others[..i]).position(|of| same(&of));
            require(twice.is_none(), key, || {
                let first = match twice.unwrap_or(0) {
                    0 => "the first mode".into(),
                    j => format!("other_modes[{}]", j - 1),
                };
                format!("expected a mode of its own, found {first} again: remove it")
            })?;
        }
        Ok(())
    }

    /// Where a certificate holds its figures are numbers, and those of what it claims.
    fn validate_certificate(&self) -> Result<(), Violation> {
        let Certificate { blocks, demonstrated_frames, displaced_frames, step_s, .. } =
            &self.certificate;
        if !self.certificate.holds() {
            return Ok(());
        }
        positive("certificate.step_s", *step_s)?;
        for (name, rollouts) in
            [("demonstrated_frames", demonstrated_frames), ("displaced_frames", displaced_frames)]
        {
            let key = format!("certificate.{name}");
            let Rollouts { starts, reached, .. } = rollouts;
            require(reached == starts, format!("{key}.reached"), || {
                format!("expected all of the {starts} starts, found {reached}")
            })?;
            for (figure, value) in [
                ("goal_error_max_m", rollouts.goal_error_max_m),
                ("goal_error_max_rad", rollouts.goal_error_max_rad),
                ("energy_rise_max", rollouts.energy_rise_max),
            ] {
                finite(&format!("{key}.{figure}"), &[value])?;
                require(value >= 0.0, format!("{key}.{figure}"), || {
                    format!("expected a number from zero on, found {value}")
                })?;
            }
        }
        let expected: &[&str] = match (&self.policy, self.manifold) {
            (PolicyModel::Canonical { .. }, manifold) if manifold.has_orientation() => {
                &["position", "orientation"]
            }
            (PolicyModel::Thesis(_), Manifold::R3S3) => &["pose"],
            _ => &["position"],
        };
        let found: Vec<&str> = blocks.iter().map(|block| block.name.as_str()).collect();
        require(found == expected, "certificate.blocks", || {
            format!("expected blocks {expected:?}, found {found:?}")
        })
    }

    fn validate_gripper(&self) -> Result<(), Violation> {
        let count = self.gripper.len();
        require(count <= GRIPPER_EVENTS_MAX, "gripper", || {
            format!("expected at most {GRIPPER_EVENTS_MAX} events, found {count}")
        })?;
        let (mut before, mut last) = (0.0, None);
        for (i, event) in self.gripper.iter().enumerate() {
            let key = format!("gripper[{i}]");
            let GripperEvent { phase, time_fraction, action, spread, demonstrations } = *event;
            require((before..=1.0).contains(&phase), format!("{key}.phase"), || {
                format!("expected phases that rise from 0 to 1, found {phase} after {before}")
            })?;
            before = phase;
            let again = !matches!(action, GripperAction::WidthM(_)) && last == Some(action);
            require(!again, format!("{key}.action"), || {
                let twice = format!("found that it {action} twice in a row");
                format!("expected a gripper that opens and closes by turns, {twice}: remove one")
            })?;
            last = Some(action);
            for (name, value) in [("time_fraction", time_fraction), ("spread", spread)] {
                require((0.0..=1.0).contains(&value), format!("{key}.{name}"), || {
                    format!("expected a number from 0 to 1, found {value}")
                })?;
            }
            let most = self.provenance.demonstrations.len();
            let is_some = (1..=most).contains(&(demonstrations as usize));
            require(is_some, format!("{key}.demonstrations"), || {
                format!("expected 1 to {most}, as many as there are, found {demonstrations}")
            })?;
            if let GripperAction::WidthM(width_m) = action {
                finite(&format!("{key}.action"), &[width_m])?;
                require(width_m >= 0.0, format!("{key}.action"), || {
                    format!("expected a width from zero on, found {width_m}")
                })?;
            }
        }
        Ok(())
    }

    fn validate_frames(&self) -> Result<(), Violation> {
        let mut known = vec![&self.start_frame, &self.goal_frame];
        known.dedup();
        let count = self.frames.len();
        require(count >= known.len() && count <= FRAME_CAPACITY, "frames", || {
            format!("expected {} to {FRAME_CAPACITY} frames, found {count}", known.len())
        })?;
        for (p, frame) in self.frames.iter().enumerate() {
            let key = format!("frames[{p}]");
            if let Some(name) = known.get(p) {
                require(frame.name == **name, format!("{key}.name"), || {
                    format!("expected `{name}`, found `{}`", frame.name)
                })?;
            }
            let twice = self.frames[..p].iter().any(|other| other.name == frame.name);
            name(&format!("{key}.name"), &frame.name)?;
            require(!twice, format!("{key}.name"), || {
                format!("expected a name of its own, found `{}`", frame.name)
            })?;
            let (found, expected) = (frame.gaussians.len(), self.gaussians.len());
            require(found == expected, format!("{key}.gaussians"), || {
                format!("expected {expected}, as in `gaussians`, found {found}")
            })?;
            for (k, g) in frame.gaussians.iter().enumerate() {
                let key = format!("{key}.gaussians[{k}]");
                let dimension = self.manifold.position_dimension();
                vector(&format!("{key}.position_m"), &g.position_m, dimension)?;
                positive_definite(
                    &format!("{key}.covariance"),
                    &g.covariance,
                    self.manifold.dimension(),
                )?;
                let key = format!("{key}.quaternion_wxyz");
                require(
                    g.quaternion_wxyz.is_some() == self.manifold.has_orientation(),
                    &key,
                    || {
                        format!(
                            "expected one exactly when the manifold ({}) has one",
                            self.manifold
                        )
                    },
                )?;
                if let Some(wxyz) = &g.quaternion_wxyz {
                    unit_quaternion(&key, wxyz)?;
                }
            }
        }
        Ok(())
    }

    fn validate_waypoints(&self) -> Result<(), Violation> {
        for (i, waypoint) in self.canonical.waypoints.iter().enumerate() {
            let key = format!("canonical.waypoints[{i}]");
            pose(&format!("{key}.pose"), &waypoint.pose)?;
            finite(&format!("{key}.point_m"), &waypoint.point_m)?;
            let others = [&self.start_frame, &self.goal_frame];
            let known = self.frames.iter().any(|frame| frame.name == waypoint.frame);
            let before = &self.canonical.waypoints[..i];
            let twice = before.iter().any(|other| other.frame == waypoint.frame);
            require(
                known && !twice && !others.contains(&&waypoint.frame),
                format!("{key}.frame"),
                || {
                    format!(
                        "expected a frame of its own among `frames`, found `{}`",
                        waypoint.frame
                    )
                },
            )?;
        }
        let range = |key: &str, phase: f64| {
            require((0.0..=1.0).contains(&phase), format!("canonical.{key}"), || {
                format!("expected a phase from 0 to 1, found {phase}")
            })
        };
        range("start_phase", self.canonical.start_phase)?;
        range("goal_phase", self.canonical.goal_phase)?;
        self.frame_map().map(|_| ()).map_err(|error| {
            let problem = format!(
                "expected phases that rise from `start_phase` to `goal_phase` by at least \
                 {PHASE_DISTANCE_MIN} a frame ({error:?})"
            );
            ("canonical.waypoints".into(), problem)
        })
    }

    fn validate_adaptation(&self) -> Result<(), Violation> {
        let Some(adaptation) = &self.canonical.adaptation else { return Ok(()) };
        let key = "canonical.adaptation";
        require(
            self.canonical.waypoints.is_empty() && self.start_frame != self.goal_frame,
            key,
            || "expected none for a skill that has not just a start and a goal frame".into(),
        )?;
        for (name, reach) in [("reach_m", adaptation.reach_m), ("reach_rad", adaptation.reach_rad)]
        {
            require(reach.is_finite() && reach >= 0.0, format!("{key}.{name}"), || {
                format!("expected zero or more, found {reach}")
            })?;
        }
        let found = adaptation.coefficients.len();
        require(found == SPLINES, format!("{key}.coefficients"), || {
            format!("expected {SPLINES}, found {found}")
        })?;
        for (j, rows) in adaptation.coefficients.iter().enumerate() {
            finite(&format!("{key}.coefficients[{j}]"), rows.as_flattened())?;
        }
        Ok(())
    }

    fn validate_canonical(
        &self,
        position: &FieldModel,
        orientation: Option<&FieldModel>,
    ) -> Result<(), Violation> {
        if !self.motion.is_discrete() {
            return self.validate_rounds(position, orientation);
        }
        let key = "policy.position";
        field(key, position, self.manifold.position_dimension())?;
        let goal = &position.components[position.components.len() - 1].mean;
        let expected = &self.canonical.goal.position_m;
        let (phase, goal) = goal.split_last().expect("its length was checked");
        require(
            *phase == 1.0 && goal.iter().zip(expected).all(|(a, b)| (a - b).abs() < TOLERANCE),
            format!("{key}.components"),
            || "expected the last component at `canonical.goal` and phase 1".into(),
        )?;
        let key = "policy.orientation";
        require(orientation.is_some() == self.manifold.has_orientation(), key, || {
            format!("expected a field exactly when the manifold ({}) has one", self.manifold)
        })?;
        if let Some(orientation) = orientation {
            field(key, orientation, 3)?;
            let goal = &orientation.components[orientation.components.len() - 1].mean;
            let (phase, goal) = goal.split_last().expect("its length was checked");
            let at_goal = *phase == 1.0 && goal.iter().all(|x| *x == 0.0);
            require(at_goal, format!("{key}.components"), || {
                "expected the last component at zero and phase 1".into()
            })?;
        }
        Ok(())
    }

    /// What goes round has one frame, one mode and nothing that happens once.
    fn validate_motion(&self) -> Result<(), Violation> {
        let cycle = self.certificate.cycle.as_ref();
        let Some(period_s) = self.motion.period_s() else {
            return require(cycle.is_none(), "certificate.cycle", || {
                "expected none for a skill that goes to a goal".into()
            });
        };
        positive("motion.period_s", period_s)?;
        require(matches!(self.policy, PolicyModel::Canonical { .. }), "policy", || {
            "expected a canonical policy for a periodic skill".into()
        })?;
        require(self.start_frame == self.goal_frame, "goal_frame", || {
            format!(
                "expected `{}`, the start frame, for a periodic skill, found `{}`",
                self.start_frame, self.goal_frame
            )
        })?;
        for (key, count) in [
            ("frames", self.frames.len() - 1),
            ("canonical.waypoints", self.canonical.waypoints.len()),
            ("gripper", self.gripper.len()),
            ("other_modes", self.other_modes.len()),
        ] {
            require(count == 0, key, || {
                format!(
                    "expected a periodic skill of one frame, without events and other modes, found {count} more"
                )
            })?;
        }
        self.validate_cycle(period_s)
    }

    /// The figures of a round agree with each other.
    fn validate_cycle(&self, period_s: f64) -> Result<(), Violation> {
        let Some(cycle) = &self.certificate.cycle else {
            return require(!self.certificate.holds(), "certificate.cycle", || {
                "expected one for a periodic skill, found none".into()
            });
        };
        for (key, found) in [
            ("certificate.cycle.demonstrated_period_s", cycle.demonstrated_period_s),
            ("fit.duration_s", self.fit.duration_s),
        ] {
            let same = (found - period_s).abs() <= TOLERANCE * period_s;
            require(same, "motion.period_s", || {
                format!(
                    "expected the {found} s of `{key}`, found {period_s}: one was edited, train \
                     the skill again"
                )
            })?;
        }
        let rolled_out = self.fit.demonstrations.first();
        let same = rolled_out.is_none_or(|first| first.execution_s == cycle.period_s);
        require(same, "certificate.cycle.period_s", || {
            format!(
                "expected `fit.demonstrations[0].execution_s`, found {}: one was edited, train the \
                 skill again",
                cycle.period_s
            )
        })?;
        if !self.certificate.holds() {
            return Ok(());
        }
        for (key, value) in [
            ("period_s", cycle.period_s),
            ("demonstrated_period_s", cycle.demonstrated_period_s),
            ("beside_rms_m", cycle.beside_rms_m),
            ("beside_rms_rad", cycle.beside_rms_rad),
            ("beside_max_m", cycle.beside_max_m),
            ("beside_max_rad", cycle.beside_max_rad),
            ("return_max_m", cycle.return_max_m),
            ("return_max_rad", cycle.return_max_rad),
        ] {
            let key = format!("certificate.cycle.{key}");
            finite(&key, &[value])?;
            require(value >= 0.0, key, || format!("expected zero or more, found {value}"))?;
        }
        positive("certificate.cycle.period_s", cycle.period_s)
    }

    /// The fields of a periodic skill.
    fn validate_rounds(
        &self,
        position: &FieldModel,
        orientation: Option<&FieldModel>,
    ) -> Result<(), Violation> {
        round("policy.position", position, self.manifold.position_dimension())?;
        let key = "policy.orientation";
        require(orientation.is_some() == self.manifold.has_orientation(), key, || {
            format!("expected a field exactly when the manifold ({}) has one", self.manifold)
        })?;
        orientation.map_or(Ok(()), |field| round(key, field, 3))
    }

    fn validate_thesis(&self, policy: &ThesisModel) -> Result<(), Violation> {
        positive("policy.metric_scale", policy.metric_scale)?;
        positive("policy.huber_threshold", policy.huber_threshold)?;
        let count = self.gaussians.len();
        require(count <= COMPONENT_CAPACITY, "gaussians", || {
            format!("expected at most {COMPONENT_CAPACITY}, found {count}")
        })?;
        vector("policy.potentials", &policy.potentials, count)?;
        vector("policy.damping", &policy.damping, count)?;
        for (k, damping) in policy.damping.iter().enumerate() {
            positive(&format!("policy.damping[{k}]"), *damping)?;
        }
        Ok(())
    }
}

fn require(
    holds: bool,
    key: impl AsRef<str>,
    problem: impl FnOnce() -> String,
) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err((key.as_ref().into(), problem())) }
}

fn finite(key: &str, values: &[f64]) -> Result<(), Violation> {
    match values.iter().find(|x| !x.is_finite() || x.abs() > NUMBER_MAX) {
        None => Ok(()),
        Some(x) if x.is_finite() => {
            Err((key.into(), format!("expected numbers within {NUMBER_MAX:e}, found {x:e}")))
        }
        Some(x) => Err((key.into(), format!("expected finite numbers, found {x}"))),
    }
}

fn positive(key: &str, value: f64) -> Result<(), Violation> {
    finite(key, &[value])?;
    require(value > 0.0, key, || format!("expected a positive number, found {value}"))
}

fn pose(key: &str, pose: &Pose) -> Result<(), Violation> {
    finite(&format!("{key}.position_m"), &pose.position_m)?;
    unit_quaternion(&format!("{key}.quaternion_wxyz"), &pose.quaternion_wxyz)
}

fn unit_quaternion(key: &str, wxyz: &[f64; 4]) -> Result<(), Violation> {
    finite(key, wxyz)?;
    let norm = nalgebra::Vector4::from(*wxyz).norm();
    require((norm - 1.0).abs() < TOLERANCE, key, || {
        format!("expected a unit quaternion, found one of length {norm}")
    })
}

fn vector(key: &str, vector: &[f64], dimension: usize) -> Result<(), Violation> {
    require(vector.len() == dimension, key, || {
        format!("expected {dimension} numbers, found {}", vector.len())
    })?;
    finite(key, vector)
}

/// A symmetric matrix, from its rows.
fn symmetric(key: &str, rows: &[Vec<f64>], dimension: usize) -> Result<DMatrix<f64>, Violation> {
    require(rows.len() == dimension, key, || {
        format!("expected {dimension} rows, found {}", rows.len())
    })?;
    for row in rows {
        vector(key, row, dimension)?;
    }
    let matrix = DMatrix::from_fn(dimension, dimension, |i, j| rows[i][j]);
    let skew = (&matrix - matrix.transpose()).amax();
    require(skew <= TOLERANCE * matrix.amax(), key, || {
        format!("expected a symmetric matrix, found entries that differ by {skew}")
    })?;
    Ok(matrix)
}

fn positive_definite(
    key: &str,
    rows: &[Vec<f64>],
    dimension: usize,
) -> Result<DMatrix<f64>, Violation> {
    let matrix = symmetric(key, rows, dimension)?;
    require(matrix.clone().cholesky().is_some(), key, || {
        "expected a positive definite matrix".into()
    })?;
    Ok(matrix)
}

/// A field that goes round: the components of one round.
fn round(key: &str, field: &FieldModel, dimension: usize) -> Result<(), Violation> {
    let fall = field.fall_per_round.unwrap_or(0.0);
    positive(&format!("{key}.fall_per_round"), fall)?;
    positive(&format!("{key}.damping_1_s"), field.damping_1_s)?;
    positive(&format!("{key}.phase_width"), field.phase_width)?;
    let count = field.components.len();
    require((2..=COMPONENT_CAPACITY).contains(&count), format!("{key}.components"), || {
        format!("expected 2 to {COMPONENT_CAPACITY} components, found {count}")
    })?;
    let mut before = 0.0;
    for (k, c) in field.components.iter().enumerate() {
        let key = format!("{key}.components[{k}]");
        component(&key, c, dimension + 1, false)?;
        let phase = c.mean[dimension];
        let rises = if k == 0 { phase >= 0.0 } else { phase > before };
        require(rises && phase < 1.0, format!("{key}.mean"), || {
            format!("expected phases that rise from 0 to below 1, found {phase} after {before}")
        })?;
        before = phase;
    }
    let copies = field.copies().len();
    require((count..=COMPONENT_CAPACITY).contains(&copies), format!("{key}.components"), || {
        format!(
            "expected at most {COMPONENT_CAPACITY} components with their copies in the rounds before and after, \
             found {copies}"
        )
    })
}

fn field(key: &str, field: &FieldModel, dimension: usize) -> Result<(), Violation> {
    require(field.fall_per_round.is_none(), format!("{key}.fall_per_round"), || {
        "expected none for a skill that goes to a goal".into()
    })?;
    positive(&format!("{key}.damping_1_s"), field.damping_1_s)?;
    let count = field.components.len();
    require((2..=COMPONENT_CAPACITY).contains(&count), format!("{key}.components"), || {
        format!("expected 2 to {COMPONENT_CAPACITY} components, found {count}")
    })?;
    for (k, c) in field.components.iter().enumerate() {
        component(&format!("{key}.components[{k}]"), c, dimension + 1, k + 1 == count)?;
    }
    positive(&format!("{key}.phase_width"), field.phase_width)
}

fn component(
    key: &str,
    component: &Component,
    dimension: usize,
    is_goal: bool,
) -> Result<(), Violation> {
    vector(&format!("{key}.mean"), &component.mean, dimension)?;
    let metric_key = format!("{key}.metric");
    let metric = positive_definite(&metric_key, &component.metric, dimension)?;
    finite(&format!("{key}.potential"), &[component.potential])?;
    vector(&format!("{key}.gradient"), &component.gradient, dimension)?;
    symmetric(&format!("{key}.hessian"), &component.hessian, dimension)?;
    if is_goal {
        // The inertia of the phase is its own.
        let mut expected = DMatrix::identity(dimension, dimension);
        expected[(dimension - 1, dimension - 1)] = metric[(dimension - 1, dimension - 1)];
        let excess = (metric - expected).amax();
        require(excess < TOLERANCE, metric_key, || {
            format!("expected the identity at the goal, found entries {excess} away")
        })?;
        require(component.potential == 0.0, format!("{key}.potential"), || {
            format!("expected zero at the goal, found {}", component.potential)
        })?;
        require(component.gradient.iter().all(|x| *x == 0.0), format!("{key}.gradient"), || {
            "expected zero at the goal".into()
        })?;
    }
    Ok(())
}

fn gaussian(key: &str, gaussian: &Gaussian, dimension: usize) -> Result<(), Violation> {
    positive(&format!("{key}.prior"), gaussian.prior)?;
    finite(&format!("{key}.phase"), &[gaussian.phase])?;
    vector(&format!("{key}.mean"), &gaussian.mean, dimension)?;
    positive_definite(&format!("{key}.covariance"), &gaussian.covariance, dimension)?;
    Ok(())
}
