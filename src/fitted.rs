//! Constants that were fitted on a set of problems, in the `tuning.rs` of each layer. Constants
//! that follow from rounding or theory stand beside their use.

/// Defines functions that return fitted constants.
///
/// With the feature `tuning`, which only `benches/tuning.py` compiles, the environment variable
/// `BIPOT_TUNING="name=value"` replaces one of them.
macro_rules! fitted {
    ($($(#[$doc:meta])* $name:ident: $kind:ident = $value:expr;)+) => {$(
        $(#[$doc])*
        #[inline]
        pub(crate) fn $name() -> $kind {
            #[cfg(feature = "tuning")]
            {
                static VALUE: std::sync::OnceLock<$kind> = std::sync::OnceLock::new();
                let key = concat!(module_path!(), "::", stringify!($name));
                *VALUE.get_or_init(|| crate::fitted::replaced(key).unwrap_or($value))
            }
            #[cfg(not(feature = "tuning"))]
            {
                $value
            }
        }
    )+
    };
}
pub(crate) use fitted;

/// The value that the environment gives a constant.
#[cfg(feature = "tuning")]
pub(crate) fn replaced<T: std::str::FromStr>(key: &str) -> Option<T> {
    let text = std::env::var("BIPOT_TUNING").ok()?;
    let (name, value) = text.split_once('=')?;
    (name == key).then(|| value.parse().ok())?
}
