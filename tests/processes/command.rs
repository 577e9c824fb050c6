//! External commands of the tool of a running controller, as a user gives them.

use std::process::Stdio;

use crate::common::{Place, finish, program, text};
use crate::robot::{Robot, signal, start, stop_live};

#[test]
fn a_command_leads_the_point_from_its_goal_and_let_go_it_comes_back() {
    let place = Place::new("tool-command");
    let (mut robot, controller) = start(&place, &[]);
    let from_goal = |robot: &Robot| {
        let [x, y, ..] = robot.state.position;
        (x - 2.0).hypot(y - 1.0)
    };
    robot.until("at the goal", Robot::live, |robot, _| from_goal(robot) < 0.003);
    let commander = program("sim-bridge")
        .args(["command", "--instance", &place.instance, "--for-s", "600"])
        .args(["--linear", "0", "-1", "0"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    robot.until("commanded away", Robot::live, |robot, _| robot.state.position[1] < 0.8);
    signal(&commander, "-INT");
    robot.until("back at the goal", Robot::live, |robot, _| from_goal(robot) < 0.003);
    let said = finish(commander);
    assert!(said.status.success(), "{}", text(&said));
    let said = text(&said);
    assert!(said.contains("commanding 0 -1 0 m/s") && said.contains("let go"), "{said}");
    stop_live(robot, controller);
    assert!(place.leftovers().is_empty());
}
