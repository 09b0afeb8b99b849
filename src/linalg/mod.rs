pub mod least_squares;
pub mod small;
