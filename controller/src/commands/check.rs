//! `controller check`: are the files right, and what does this machine lack for real time?

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;
use nalgebra::SVector;
use tprmp_messages::free_shared_memory_bytes;
use tprmp_model::controller_config::{self, Capability, ControllerConfig, RealTime, ToolOffset};
use tprmp_model::skill_model::{FrameMixture, Manifold, PolicyModel, SkillModel};
use tprmp_robot::{
    Chain, ControlPoints, Document, Ignored, SelfPairs, gravity_torques, remarks, spread_posture,
};
use tprmp_spatial::Pose;

use crate::freedom::Freedom;
use crate::motion::limits::working_range;
use crate::startup::{self, Loaded, LoadedSkill, StartError, WithRobot};
use crate::timing::realtime;
use crate::tool_axis;

/// Checks the files, which is an error when they are wrong, and the machine, which is a list of
/// remedies.
///
/// # Errors
/// The first thing that would keep the controller from starting.
pub fn check(config_path: &Path, model_paths: &[PathBuf]) -> Result<(), StartError> {
    let config = controller_config::read(config_path)?;
    startup::check_names(config_path, &config)?;
    line("ok", "configuration", &config_path.display().to_string());
    let (document, was_expanded) = Document::read_expanding(&config.robot.urdf)?;
    let describe = Describe { config_path, config: &config, document: &document };
    startup::with_robot_of(config_path, &config, &document, describe)??;
    for remark in remarks(&document, &config.selection())? {
        line("warn", "robot", &format!("{}: {remark}", document.file.display()));
    }
    if !model_paths.is_empty() {
        let loaded = startup::load(config_path, model_paths, true)?;
        let fits = Fits { config_path, loaded: &loaded, document: &document };
        startup::with_robot_of(config_path, &config, &document, fits)??;
        for (path, skill) in model_paths.iter().zip(&loaded.skills) {
            describe_model(path, &skill.model);
            if skill.manifold != skill.model.manifold {
                let text = format!(
                    "moves {} of it (`skill.moves`): the arm and other leaves decide about the rest",
                    skill.manifold
                );
                line("ok", "moves", &text);
            }
        }
    }
    check_machine(&config);
    if was_expanded {
        // The controller itself runs no other program: it has to be given what comes out.
        Document::read(&config.robot.urdf)?;
    }
    Ok(())
}

fn describe_model(path: &Path, model: &SkillModel) {
    let way = match model.motion.period_s() {
        None => format!("from `{}` to `{}`", model.start_frame, model.goal_frame),
        Some(_) => format!("round, fixed to `{}`", model.goal_frame),
    };
    let text = format!(
        "{}: skill `{}` on {} {way}, {} Gaussians",
        path.display(),
        model.skill,
        model.manifold,
        model.gaussians.len(),
    );
    line("ok", "model", &text);
    if let Some(text) = model.cycle_line() {
        line("ok", "limit cycle", &text);
    }
    let modes = model.modes();
    if modes.len() > 1 {
        let text = format!("{} ways of doing it, decided on when it starts", modes.len());
        line("ok", "modes", &text);
    }
    for event in &model.gripper {
        line("ok", "gripper", &event.described(model.provenance.demonstrations.len()));
    }
    match model.failures().first() {
        None if model.motion.is_discrete() => {
            line("ok", "certificate", "holds; metric, valley and goal were looked at again");
        }
        None => line("ok", "certificate", "holds; metric and valley were looked at again"),
        Some(failure) => line(
            "lack",
            "certificate",
            &format!("{failure}: it is run with --allow-uncertified only"),
        ),
    }
    if let Some(text) = model.fewer_frames() {
        line("lack", "frames", &text);
    }
    for (verdict, text) in frame_lines(model) {
        line(verdict, "frame", &text);
    }
}

/// Which frame of a model speaks when, and what is wrong with that.
fn frame_lines(model: &SkillModel) -> Vec<(&'static str, String)> {
    if !matches!(model.policy, PolicyModel::Canonical { .. }) {
        return Vec::new();
    }
    let role = |frame: &FrameMixture| {
        let text = format!("`{}` {}", frame.name, model.frame_role(frame));
        if model.is_left_out(frame) {
            ("lack", format!("{text}: the skill names it, and its path does not pass it"))
        } else {
            ("ok", text)
        }
    };
    let lost = model.lost_agreement().into_iter().map(|text| ("lack", text));
    model.frames.iter().map(role).chain(lost).collect()
}

fn line(verdict: &str, what: &str, text: &str) {
    // A reader that has gone away, as in `controller check … | head`, is no reason to fail.
    let _ = writeln!(std::io::stdout(), "{verdict:>4}  {what:<16} {text}");
}

struct Describe<'a> {
    config_path: &'a Path,
    config: &'a ControllerConfig,
    document: &'a Document,
}

impl WithRobot for Describe<'_> {
    type Output = Result<(), StartError>;

    fn call<const N: usize>(self) -> Result<(), StartError> {
        let (chain, points) = startup::robot_of::<N>(self.config_path, self.config, self.document)?;
        let text = format!(
            "{}: {N} joints from `{}` to `{}`, {} control points",
            self.config.robot.urdf.display(),
            chain.root_link(),
            chain.tool_link(),
            points.as_slice().len()
        );
        line("ok", "robot", &text);
        let range = working_range(&chain, &self.config.robot);
        line("ok", "tool", &Freedom::of(&chain, &range).to_string());
        if let Some(payload) = &self.config.robot.payload {
            line("ok", "payload", &format!("{} kg at {:?} m", payload.mass_kg, payload.centre_m));
        }
        for (i, needed) in too_heavy(&chain, &range, self.config) {
            let text = format!(
                "joint `{}`: to hold the arm and what it carries takes {needed:.0} N m or N in some posture, its effort \
                 limit is {}",
                chain.joint_names()[i],
                chain.effort_max()[i]
            );
            line("warn", "robot", &text);
        }
        if self.config.collision.is_none() && self.config.self_collision.is_none() {
            let text = "nothing is kept clear: `collision` and `self_collision` are None";
            line("warn", "control points", text);
        } else {
            list_control_points(&chain, self.document, &points);
        }
        if let Some(own) = &self.config.self_collision {
            list_pairs(&chain, &SelfPairs::new(&chain, &points, &own.exempt));
        }
        Ok(())
    }
}

/// Joints whose effort limit does not hold the arm with its payload in one of 200 postures within this range, and
/// what that takes at most \[N m or N\].
fn too_heavy<const N: usize>(
    chain: &Chain<N>,
    [lower, upper]: &[SVector<f64, N>; 2],
    config: &ControllerConfig,
) -> Vec<(usize, f64)> {
    let mut most = SVector::<f64, N>::zeros();
    for k in 1..=200 {
        let q = spread_posture(lower, upper, k);
        let gravity = gravity_torques(chain, &q, config.robot.gravity_m_s2.into());
        most = most.sup(&gravity.abs());
    }
    (0..N).map(|i| (i, most[i])).filter(|(i, needed)| *needed > chain.effort_max()[*i]).collect()
}

struct Fits<'a> {
    config_path: &'a Path,
    loaded: &'a Loaded,
    document: &'a Document,
}

impl WithRobot for Fits<'_> {
    type Output = Result<(), StartError>;

    fn call<const N: usize>(self) -> Result<(), StartError> {
        let Self { config_path, loaded, document } = self;
        let (chain, _) = startup::robot_of::<N>(config_path, &loaded.config, document)?;
        startup::check_freedom(config_path, &chain, loaded)?;
        let range = working_range(&chain, &loaded.config.robot);
        let leaves_tilt = |skill: &&LoadedSkill| skill.manifold == Manifold::R3S1;
        let tilts = Freedom::of(&chain, &range).rank(&[3, 4]) > 0;
        if tilts
            && loaded.config.keep_upright.is_none()
            && let Some(skill) = loaded.skills.iter().find(leaves_tilt)
        {
            let text = format!(
                "`{}` leaves the tilt of the tool alone, which this arm can change: `keep_upright` keeps it",
                skill.path.display()
            );
            line("warn", "tool", &text);
        }
        let middle = 0.5 * (range[0] + range[1]);
        let own = tool_axis::approach_axis(&chain, &middle);
        for skill in &loaded.skills {
            if let Some(text) = approach_fault(skill, own, loaded.config.robot.tool_offset.as_ref())
            {
                line("warn", "tool", &text);
            }
        }
        Ok(())
    }
}

/// What is wrong where a skill comes to its goal along another axis of the tool than the arm's tool points along, and
/// the offset with which it would.
fn approach_fault(skill: &LoadedSkill, own: DVec3, offset: Option<&ToolOffset>) -> Option<String> {
    if skill.manifold != skill.model.manifold {
        return None;
    }
    let taught = skill.model.motion.is_discrete().then(|| skill.model.approach_axis())??;
    let taught = tool_axis::snapped(taught);
    let angle = taught.angle_between(own).to_degrees();
    if angle < tool_axis::APART_DEG {
        return None;
    }
    let Pose { position: at, orientation } = offset.map_or(Pose::IDENTITY, ToolOffset::pose);
    let q = orientation * tool_axis::orientation(own, taught);
    Some(format!(
        "`{}` comes to its goal along the {} axis of its tool, this arm's tool points along its {} axis, {angle:.0}° \
         apart: a fixed transform is missing. `robot.tool_offset: Some((frame: {:?}, position_m: ({:?}, {:?}, {:?}), \
         quaternion_wxyz: ({:.6}, {:.6}, {:.6}, {:.6})))` turns it",
        skill.path.display(),
        tool_axis::named(taught),
        tool_axis::named(own),
        skill.model.tool_frame,
        at.x,
        at.y,
        at.z,
        q.w,
        q.x,
        q.y,
        q.z,
    ))
}

/// How many spheres cover each link, and how large they are. A link that is not kept clear was accepted at the
/// start-up's checks: it is exempt, or nothing keeps clear.
fn list_control_points<const N: usize>(
    chain: &Chain<N>,
    document: &Document,
    points: &ControlPoints,
) {
    let uncovered = startup::uncovered_links(chain, document, points);
    for (index, (link, _)) in chain.moving_links().iter().enumerate() {
        let radii = points.as_slice().iter().filter(|p| p.link == index).map(|p| p.radius);
        let (count, least, most) = radii
            .fold((0, f64::INFINITY, 0.0_f64), |(n, least, most), r| {
                (n + 1, least.min(r), most.max(r))
            });
        let text = match count {
            0 if uncovered.contains(&link.as_str()) => {
                let text =
                    format!("{link}: has collision shapes and no control points, not kept clear");
                line("lack", "control points", &text);
                continue;
            }
            0 => format!("{link}: no collision shape"),
            1 => format!("{link}: 1 sphere of {:.0} mm covers it", most * 1e3),
            _ => format!(
                "{link}: {count} spheres of {:.0} to {:.0} mm cover it",
                least * 1e3,
                most * 1e3
            ),
        };
        line("ok", "control points", &text);
    }
}

/// Which links are kept clear of each other, and which are not.
fn list_pairs<const N: usize>(chain: &Chain<N>, pairs: &SelfPairs) {
    let name = |link: usize| chain.moving_links()[link].0.as_str();
    let text = format!("{} pairs of spheres are kept apart", pairs.watched.len());
    line("ok", "self-collision", &text);
    for (kind, why) in [
        (Ignored::Adjacent, "neighbours"),
        (
            Ignored::Touching,
            "touch in nearly every posture: where they could collide, `robot.working_range` has to keep the joints \
             between them from it",
        ),
        (Ignored::Exempt, "exempt"),
    ] {
        let of_kind = pairs.ignored.iter().filter(|(.., why)| *why == kind);
        let list: Vec<_> =
            of_kind.map(|(one, other, _)| format!("{} and {}", name(*one), name(*other))).collect();
        if !list.is_empty() {
            let text = format!("not watched, {why}: {}", list.join("; "));
            line("ok", "self-collision", &text);
        }
    }
}

/// Tries on this thread what the loop would ask for, and looks at what it depends on.
fn check_machine(config: &ControllerConfig) {
    check_capabilities(&config.real_time);
    match free_shared_memory_bytes() {
        Ok(u64::MAX) => line("ok", "shared memory", "/dev/shm has no limit"),
        Ok(free) => line("ok", "shared memory", &format!("{} MiB free in /dev/shm", free >> 20)),
        Err(fault) => line("lack", "shared memory", &fault.to_string()),
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if cores >= 2 {
        line("ok", "cores", &format!("{cores} cores"));
    } else {
        line("lack", "cores", "1 core: controller and state publisher will wait for each other");
    }
    check_processor();
    match std::fs::read_to_string("/sys/kernel/realtime") {
        Ok(text) if text.trim() == "1" => line("ok", "kernel", "PREEMPT_RT"),
        _ => line(
            "lack",
            "kernel",
            "not PREEMPT_RT: wake-ups may be late by milliseconds under load; install a real-time \
             kernel where deadlines are hard",
        ),
    }
    match std::fs::read_to_string("/proc/sys/kernel/sched_rt_runtime_us").as_deref().map(str::trim)
    {
        Ok("-1") | Err(_) => line("ok", "throttling", "real-time threads are not throttled"),
        Ok(runtime) => line(
            "ok",
            "throttling",
            &format!(
                "real-time threads may use {runtime} µs of each second's 1000000 µs: ample \
                      for a loop that sleeps"
            ),
        ),
    }
}

/// Asks for everything that a loop could want, whether this configuration wants it or not.
fn check_capabilities(config: &RealTime) {
    let wanted = RealTime {
        fifo_priority: config.fifo_priority.or(Some(80)),
        lock_memory: true,
        cpu_latency_max_us: config.cpu_latency_max_us.or(Some(0)),
        ..config.clone()
    };
    let granted = realtime::set_up(&wanted);
    let core = wanted.cpu.map(|cpu| format!("the loop may be kept on core {cpu}"));
    let priority = wanted.fifo_priority.unwrap_or_default();
    for (capability, what, good) in [
        (
            Capability::FifoPriority,
            "scheduling",
            Some(format!("SCHED_FIFO priority {priority} is granted")),
        ),
        (Capability::Cpu, "core", core),
        (Capability::LockMemory, "locked memory", Some("mlockall is granted".into())),
        (
            Capability::CpuLatency,
            "core sleep",
            Some("/dev/cpu_dma_latency may be held: cores do not sleep deeply".into()),
        ),
    ] {
        let denied = granted.denied.iter().find(|denied| denied.capability == capability);
        let required = if config.required.contains(&capability) { "required, but " } else { "" };
        match (denied, good) {
            (Some(denied), _) => line("lack", what, &format!("{required}{denied}")),
            (None, Some(good)) => line("ok", what, &good),
            (None, None) => {}
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn check_processor() {
    let fast =
        std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
    if fast {
        line("ok", "processor", "AVX2 and FMA");
    } else {
        line("lack", "processor", "no AVX2 or FMA: results are the same, a tick takes longer");
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn check_processor() {
    line("ok", "processor", std::env::consts::ARCH);
}
