use super::*;
use nalgebra::{Matrix4, Vector4};

fn field() -> Field<4> {
    let component = |i: usize| {
        let s = i as f64;
        let spread = Matrix4::new(
            6.0 + s,
            0.5,
            0.2 * s,
            0.3,
            0.5,
            4.0,
            -0.3,
            -0.6,
            0.2 * s,
            -0.3,
            5.0 - 0.3 * s,
            0.1 * s,
            0.3,
            -0.6,
            0.1 * s,
            7.0,
        );
        Component {
            mean: Vector4::new(0.4 * s, 0.3 * (s - 2.0).powi(2), 0.1 * s, 0.25 * s),
            metric: spread * 0.25,
            potential: 5.0 - s,
            gradient: Vector4::new(-1.0 - 0.1 * s, 0.2, 0.1 * s, -3.0 + 0.4 * s),
            hessian: spread * (0.6 + 0.1 * s) - Matrix4::identity(),
        }
    };
    let components: Vec<_> = (0..5).map(component).collect();
    Field::new(&components, 0.2, 8.0).unwrap()
}

fn points() -> impl Iterator<Item = (Vector4<f64>, Vector4<f64>)> {
    (0..40).map(|i| {
        let s = f64::from(i);
        let y = Vector4::new(
            1.5 * (s * 0.7).sin(),
            1.5 * (s * 1.3).cos(),
            0.7 * (s * 0.31).sin(),
            0.04 * s - 0.3,
        );
        let v = Vector4::new((s * 0.9).cos(), 0.6 * (s * 0.5).sin(), 0.8 - 0.03 * s, 0.5);
        (y, v)
    })
}

fn derivative(f: impl Fn(Vector4<f64>) -> f64, y: &Vector4<f64>) -> Vector4<f64> {
    let h = 1e-4;
    Vector4::from_fn(|i, _| {
        let mut step = Vector4::zeros();
        step[i] = h;
        (8.0 * (f(y + step) - f(y - step)) - (f(y + step * 2.0) - f(y - step * 2.0))) / (12.0 * h)
    })
}

#[test]
fn it_is_the_mixture_of_its_components() {
    let field = field();
    for (z, v) in points() {
        let value = field.evaluate(&z, &v);
        let (mut sum, mut potential, mut metric) = (0.0, 0.0, Matrix4::zeros());
        for c in field.components() {
            let (offset, s) = (z - c.mean, (z[3] - c.mean[3]) / 0.2);
            let weight = (-0.5 * s * s).exp();
            let local =
                c.potential + c.gradient.dot(&offset) + 0.5 * offset.dot(&(c.hessian * offset));
            sum += weight;
            potential += weight * local;
            metric += c.metric * weight;
        }
        assert!((value.potential - potential / sum).abs() < 1e-10);
        assert!((value.metric - metric / sum).norm() < 1e-12);
        assert!((value.damping - value.metric * 8.0).norm() < 1e-12);
    }
}

#[test]
fn every_machine_gives_the_same_bits() {
    let field = field();
    for phase in (-30..60).map(|i| 0.025 * f64::from(i)) {
        let field = &field;
        let (here, portable) = (field.blend(phase), lanes::run_portable(Blending { field, phase }));
        assert_eq!(here.map(|b| b.0), portable.map(|b| b.0));
    }
}

#[test]
fn a_phase_that_is_not_finite_gives_nothing_finite() {
    for phase in [f64::NAN, f64::INFINITY] {
        let z = Vector4::new(0.1, 0.2, 0.3, phase);
        let value = field().evaluate(&z, &Vector4::x());
        assert!(!value.potential.is_finite() && value.metric.iter().all(|m| !m.is_finite()));
    }
}

#[test]
fn gradient_is_the_derivative_of_the_potential() {
    let field = field();
    for (z, v) in points() {
        let value = field.evaluate(&z, &v);
        let expected = derivative(|z| field.evaluate(&z, &v).potential, &z);
        let error = (value.gradient - expected).norm();
        assert!(error < 1e-8 * (1.0 + expected.norm()), "{error:e}");
    }
}

#[test]
fn curvature_is_that_of_the_metric() {
    let field = field();
    let h = 1e-5;
    for (z, v) in points() {
        let value = field.evaluate(&z, &v);
        let momentum_at = |s: f64| field.evaluate(&(z + v * s), &v).metric * v;
        let rate = (momentum_at(h) - momentum_at(-h)) / (2.0 * h);
        let kinetic = derivative(|z| v.dot(&(field.evaluate(&z, &v).metric * v)), &z);
        let expected = rate - kinetic * 0.5;
        let error = (value.curvature - expected).norm();
        assert!(error < 1e-6 * (1.0 + expected.norm()), "{error:e}");
    }
}

#[test]
fn far_phases_have_the_outermost_components() {
    let field = field();
    for (phase, component) in [(-40.0, 0), (60.0, 4)] {
        let z = Vector4::new(0.3, -0.2, 0.1, phase);
        let value = field.evaluate(&z, &Vector4::x());
        assert!((value.metric - field.components()[component].metric).norm() < 1e-12);
        assert!(value.gradient.iter().all(|g| g.is_finite()));
    }
}

#[test]
fn the_valley_is_the_lowest_place_of_its_phase() {
    let field = field();
    for i in 0..30 {
        let phase = -0.2 + 0.05 * f64::from(i);
        let valley = field.valley(phase).unwrap();
        let value = field.evaluate(&valley.point, &Vector4::zeros());
        assert!((valley.point[3] - phase).abs() < 1e-15);
        assert!(value.gradient.fixed_rows::<3>(0).norm() < 1e-11);
        assert!((value.gradient[3] - valley.slope).abs() < 1e-11);
        assert!((value.potential - valley.potential).abs() < 1e-11);
        let h = 1e-5;
        let at = |s: f64| field.valley(s).unwrap().potential;
        let slope = (at(phase + h) - at(phase - h)) / (2.0 * h);
        assert!((slope - valley.slope).abs() < 1e-6 * (1.0 + slope.abs()));
    }
    let mut bad = *field.components().last().unwrap();
    bad.hessian[(0, 0)] = -1.0;
    assert!(Field::new(&[bad], 0.2, 8.0).unwrap().valley(1.0).is_none());
}

#[test]
fn distance_is_that_of_the_metric_from_the_means() {
    let field = field();
    for component in field.components() {
        let alone = Field::new(&[*component], 0.2, 8.0).unwrap();
        assert_eq!(alone.distance(&component.mean), 0.0);
        for (z, _) in points() {
            let offset = z - component.mean;
            let expected = 0.5 * offset.dot(&(component.metric * offset));
            assert!((alone.distance(&z) - expected).abs() < 1e-12 * (1.0 + expected));
            assert!(field.distance(&z) > 0.0);
        }
    }
}

#[test]
fn energy_falls_along_the_policy() {
    let field = field();
    let (mut z, mut v) = (Vector4::new(-0.8, 1.0, 0.4, 0.1), Vector4::new(0.5, -0.5, 0.2, 0.3));
    let dt = 1e-3;
    let acceleration = |z: &Vector4<f64>, v: &Vector4<f64>| {
        let value = field.evaluate(z, v);
        value.metric.cholesky().unwrap().solve(&value.force(v))
    };
    let mut before = field.evaluate(&z, &v).energy(&v);
    for _ in 0..4000 {
        // Midpoint rule: its error is far below the damping's loss per step.
        let half_v = v + acceleration(&z, &v) * (dt / 2.0);
        let half_z = z + v * (dt / 2.0);
        v += acceleration(&half_z, &half_v) * dt;
        z += half_v * dt;
        let after = field.evaluate(&z, &v).energy(&v);
        assert!(after <= before + 1e-9, "energy rose by {}", after - before);
        before = after;
    }
}

#[test]
fn counts_outside_the_capacity_are_refused() {
    let field = field();
    let many = [field.components()[0]; COMPONENT_CAPACITY + 1];
    let error = |c: &[Component<4>]| Field::new(c, 0.2, 8.0).unwrap_err();
    assert_eq!(error(&[]), FieldError::ComponentCount(0));
    assert_eq!(error(&many), FieldError::ComponentCount(COMPONENT_CAPACITY + 1));
}
