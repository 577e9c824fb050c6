//! Which spheres of an arm keep clear of each other.

use crate::common::{point2d, ur5};
use tprmp_robot::{
    ControlPoints, Ignored, Kinematics, SelfPairs, forward_kinematics, point_position,
};

#[test]
fn neighbours_are_not_watched_and_distant_links_are() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let pairs = SelfPairs::new(&chain, &points, &[]);
    let link = |i: usize| chain.moving_links()[i].0.as_str();
    let watched = |a: &str, b: &str| {
        pairs.watched.iter().any(|&(i, j)| {
            let names = [i, j].map(|i| link(points.as_slice()[i].link));
            names == [a, b] || names == [b, a]
        })
    };
    assert!(watched("upper_arm_link", "wrist_2_link"));
    assert!(watched("forearm_link", "suction_tool"));
    assert!(!watched("upper_arm_link", "forearm_link"));
    let why = |a: &str, b: &str| {
        pairs.ignored.iter().find(|(i, j, _)| [link(*i), link(*j)] == [a, b]).map(|found| found.2)
    };
    assert_eq!(why("upper_arm_link", "forearm_link"), Some(Ignored::Adjacent));
    // Fixed to each other.
    assert_eq!(why("wrist_3_link", "suction_tool"), Some(Ignored::Adjacent));
    // Every pair of links is either watched or ignored.
    let links = {
        let mut links: Vec<usize> = points.as_slice().iter().map(|p| p.link).collect();
        links.dedup();
        links
    };
    for (a, &one) in links.iter().enumerate() {
        for &other in &links[a + 1..] {
            assert!(watched(link(one), link(other)) != why(link(one), link(other)).is_some());
        }
    }
}

#[test]
fn an_exempt_pair_is_not_watched_in_whichever_order_it_is_named() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let all = SelfPairs::new(&chain, &points, &[]).watched.len();
    for pair in [("forearm_link", "suction_tool"), ("suction_tool", "forearm_link")] {
        let exempt = [(pair.0.to_owned(), pair.1.to_owned())];
        let pairs = SelfPairs::new(&chain, &points, &exempt);
        assert!(pairs.watched.len() < all);
        assert!(pairs.ignored.iter().any(|(_, _, why)| *why == Ignored::Exempt));
    }
}

/// A pair that touches in any posture would hold the arm for ever.
#[test]
fn watched_links_of_the_arm_can_be_clear_of_each_other() {
    let chain = ur5();
    let points = ControlPoints::new(&chain).unwrap();
    let pairs = SelfPairs::new(&chain, &points, &[]);
    let mut kinematics = Kinematics::new();
    let stretched = [0.0, -1.2, 1.4, -1.8, -1.57, 0.0].into();
    forward_kinematics(&chain, &stretched, &mut kinematics);
    for (i, j) in pairs.watched {
        let [a, b] = [i, j].map(|i| points.as_slice()[i]);
        let place = |p: &tprmp_robot::ControlPoint| point_position(&kinematics, p.joint, p.centre);
        let apart = place(&a).distance(place(&b)) - a.radius - b.radius;
        let names = [a, b].map(|p| &chain.moving_links()[p.link].0);
        assert!(apart > 0.0, "{names:?}: {apart}");
    }
}

#[test]
fn a_point_has_no_pairs() {
    let chain = point2d();
    let points = ControlPoints::new(&chain).unwrap();
    assert!(SelfPairs::new(&chain, &points, &[]).watched.is_empty());
}
