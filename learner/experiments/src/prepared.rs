//! Policies ready to be followed from many starts.

use glam::DVec3;
use tprmp_learner::certify::policy::LearnedPolicy;
use tprmp_learner::demonstration::mean_duration_s;

use crate::baselines::dmp::Dmp;
use crate::baselines::lqr::Lqr;
use crate::baselines::pd::Pd;
use crate::bench::Bench;
use crate::conditions::Conditions;
use crate::dataset::SkillSet;
use crate::experiment::{Compared, PolicyKind, Space};
use crate::path::positions;
use crate::world::{RunOutcome, run};

/// A policy that has learned a skill, or tracks a demonstration of it.
pub(crate) enum Prepared<'a> {
    Learned(&'a LearnedPolicy),
    Pd(Pd),
    Dmp(Dmp),
    Lqr(Lqr),
}

impl Prepared<'_> {
    /// One rollout.
    pub(crate) fn follow(&self, conditions: &Conditions) -> RunOutcome {
        match self {
            Self::Learned(policy) => run(&mut policy.instance(), conditions),
            Self::Pd(pd) => run(&mut pd.clone(), conditions),
            Self::Dmp(dmp) => {
                let goal_frame = conditions.frames[1];
                let offset = goal_frame.compose(&conditions.grasp).position - goal_frame.position;
                run(&mut dmp.instance(conditions.start.pose.position, offset), conditions)
            }
            Self::Lqr(lqr) => run(&mut lqr.instance(), conditions),
        }
    }
}

impl Bench<'_> {
    /// Prepares a policy; `None` when it could not be trained.
    ///
    /// * `demonstration`  the one that PD control tracks
    pub(crate) fn prepare(
        &self,
        set: &SkillSet,
        compared: Compared,
        demonstration: usize,
    ) -> Option<Prepared<'_>> {
        let pd = |as_published| {
            let points: Vec<DVec3> = positions(set.motion(demonstration));
            let dt = set.demonstrations[demonstration].sampling_time_s;
            Prepared::Pd(Pd::new(points, dt, as_published))
        };
        let policy = compared.policy;
        Some(match policy {
            PolicyKind::Canonical | PolicyKind::Thesis => {
                let trained = self.models.get(policy, compared.components, &set.name)?;
                Prepared::Learned(&trained.policy)
            }
            PolicyKind::Pd => pd(false),
            PolicyKind::PdPublished => pd(true),
            PolicyKind::Dmp => Prepared::Dmp(Dmp::learn(&set.demonstrations)),
            PolicyKind::TpgmmLqr => Prepared::Lqr(self.regulator(set)?),
        })
    }

    /// The regulator of a planar skill.
    pub(crate) fn regulator(&self, set: &SkillSet) -> Option<Lqr> {
        let count = self.count(set, PolicyKind::Thesis);
        let model = &self.models.get(PolicyKind::Thesis, count, &set.name)?.model;
        let duration_s = mean_duration_s(&set.demonstrations);
        let skill = self.files.of(Space::Planar, PolicyKind::Thesis)?;
        Some(Lqr::new(model, skill.mixture.covariance_scale, duration_s, set.scale()))
    }
}
