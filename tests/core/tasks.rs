//! Work shared out in tasks, and panics in it: an error that quotes it, from whatever thread.

use bipot_rs::panics::{Panicked, caught};
use bipot_rs::tasks::{collect, for_each_with, map};
use rayon::prelude::*;

use crate::common::with_threads;

#[test]
fn results_keep_the_order_of_the_items() {
    for count in [0, 1, 2, 7, 1000] {
        let squares = map(0..count, |number, item| (number, item * item));
        assert!(squares.into_iter().eq((0..count).map(|i| (i, i * i))));
        let squares = collect(count, |i| i * i);
        assert!(squares.into_iter().eq((0..count).map(|i| i * i)));
    }
}

#[test]
fn memory_is_used_by_one_task_at_a_time() {
    let mut sums = vec![0; 300];
    with_threads(2, || {
        for_each_with(sums.iter_mut(), Vec::new, |memory, number, sum| {
            memory.clear();
            memory.extend(0..=number);
            *sum = memory.iter().sum();
        });
    });
    let mut sums = sums.into_iter().enumerate();
    assert!(sums.all(|(n, sum)| sum == n * (n + 1) / 2));
}

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
    let work = |from: usize| {
        caught(|| {
            with_threads(2, || {
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
