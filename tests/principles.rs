#![expect(clippy::unwrap_used, reason = "a helper of a test may fail")]
#[path = "common/cases.rs"]
mod cases;
use bipot_rs::solver::Method;
use cases::{Case, difference};

#[test]
fn look() {
    for seed in 0..12 {
        for mu in [0.3, 0.8, 2.0] {
            let plane = Case::<2>::held(10, mu, seed);
            let space = Case::<3>::held(20, mu, seed);
            let (a, b) = (plane.solve(Method::Auto), space.solve(Method::Auto));
            for (name, method) in &Method::NAMES[6..] {
                let x = plane.solve(*method);
                let y = space.solve(*method);
                println!(
                    "{seed} {mu} {name}: {:?} {} {} {:.1e} {:.1e} | {:?} {} {} {:.1e} {:.1e}",
                    x.outcome, x.iterations, x.work, x.residual, difference(&x.reaction, &a.reaction),
                    y.outcome, y.iterations, y.work, y.residual, difference(&y.reaction, &b.reaction)
                );
            }
        }
        for share in [0.9] {
            let plane = Case::<2>::floating(10, 0.4, share, seed);
            let space = Case::<3>::floating(8, 0.4, share, seed);
            for method in [Method::DisplacementPrinciple, Method::StressPrinciple] {
                let x = plane.solve(method);
                let y = space.solve(method);
                println!("float {seed} {share} {method:?}: {:?} {} {} {:.1e} | {:?} {} {} {:.1e}",
                    x.outcome, x.iterations, x.work, x.residual,
                    y.outcome, y.iterations, y.work, y.residual);
            }
        }
    }
}
