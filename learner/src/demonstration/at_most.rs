//! Lists of bounded length: what is longer is refused while it is read, not when it has filled the memory.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};

/// Most numbers of a row; poses have seven.
const ROW_MAX: usize = 16;

/// A list of at most N, for `deserialize_with`.
pub(crate) fn at_most<'de, const N: usize, T, D>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    T: Deserialize<'de>,
    D: Deserializer<'de>,
{
    deserializer.deserialize_seq(Bounded::<T, N>(PhantomData))
}

/// A list of at most N where there is one, for `deserialize_with`.
pub(crate) fn some_at_most<'de, const N: usize, T, D>(
    deserializer: D,
) -> Result<Option<Vec<T>>, D::Error>
where
    T: Deserialize<'de>,
    D: Deserializer<'de>,
{
    at_most::<N, T, D>(deserializer).map(Some)
}

struct Bounded<T, const N: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Bounded<T, N> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {N}")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            if values.len() == N {
                return Err(A::Error::custom(format!(
                    "expected at most {N} in a list, found more"
                )));
            }
            values.push(value);
        }
        Ok(values)
    }
}

/// A row of numbers.
#[derive(Debug)]
pub(crate) struct Row<T>(pub(crate) Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Row<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        at_most::<ROW_MAX, T, D>(deserializer).map(Self)
    }
}
