//! A panic becomes an error that quotes it, from whatever thread it comes.

use bipot_rs::panics::{Panicked, caught};
use rayon::prelude::*;

#[test]
fn a_result_without_panic_is_returned() {
    assert_eq!(caught(|| 3), Ok(3));
}

#[test]
fn the_message_of_a_panic_is_kept() {
    let nothing: [f64; 0] = [];
    let found = caught(|| nothing[std::hint::black_box(2)]);
    let Err(Panicked(said)) = found else {
        panic!("not caught")
    };
    assert_eq!(said, "index out of bounds: the len is 0 but the index is 2");
    let text = Panicked(said).to_string();
    assert!(text.contains("the index is 2") && text.contains("please report"));
}

#[test]
fn a_panic_of_a_worker_is_caught_and_the_pool_goes_on() {
    let pool = bipot_rs::threads::pool(2).unwrap();
    let work = |from: usize| {
        caught(|| {
            pool.install(|| {
                (from..from + 100)
                    .into_par_iter()
                    .map(|i| 1 / i)
                    .sum::<usize>()
            })
        })
    };
    assert!(work(0).is_err());
    assert_eq!(work(1), Ok(1));
}
