//! Columns that begin on cache lines, because steps read them a line at a time.

use aligned_vec::{AVec, ConstAlign};
use std::ops::{Deref, DerefMut};

/// Bytes of a cache line, and of the widest vector register.
pub const LINE: usize = 64;

/// A column whose values begin on a cache line. The usual alignment of memory is 16 bytes off, so that every load of a wide vector
/// unit touches two lines: bush-20-40 takes 12 to 14 % longer that way (AVX-512).
#[derive(Debug, PartialEq)]
pub struct AlignedColumn<T = f64>(AVec<T, ConstAlign<LINE>>);

impl<T: Copy> Clone for AlignedColumn<T> {
    fn clone(&self) -> Self {
        let mut copy = AlignedColumn::default();
        copy.clone_from(self);
        copy
    }

    /// Copies without memory of its own where both are as long.
    fn clone_from(&mut self, from: &Self) {
        if self.len() == from.len() {
            self.copy_from_slice(from);
        } else {
            self.0.clear();
            self.0.extend_from_slice(from);
        }
    }
}

impl<T> Default for AlignedColumn<T> {
    fn default() -> Self {
        AlignedColumn(AVec::new(LINE))
    }
}

impl<T: Clone> AlignedColumn<T> {
    /// So many values that are all the same.
    pub fn of(value: T, len: usize) -> Self {
        let mut column = AlignedColumn::default();
        column.resize(len, value);
        column
    }

    /// Makes it longer, by copies of a value, or shorter.
    pub fn resize(&mut self, len: usize, value: T) {
        self.0.resize(len, value);
    }
}

impl AlignedColumn {
    /// So many zeros.
    pub fn zeros(len: usize) -> Self {
        AlignedColumn::of(0.0, len)
    }
}

impl<T> FromIterator<T> for AlignedColumn<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        AlignedColumn(AVec::from_iter(LINE, values))
    }
}

impl<T> Deref for AlignedColumn<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        let values: &[T] = &self.0;
        // SAFETY: no allocation is larger than this. Vec tells the compiler the same.
        unsafe { std::hint::assert_unchecked(values.len() <= isize::MAX as usize / size_of::<T>().max(1)) };
        values
    }
}

impl<T> DerefMut for AlignedColumn<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        let values: &mut [T] = &mut self.0;
        // SAFETY: as above.
        unsafe { std::hint::assert_unchecked(values.len() <= isize::MAX as usize / size_of::<T>().max(1)) };
        values
    }
}

impl<'a, T> IntoIterator for &'a AlignedColumn<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_begin_on_lines_and_keep_what_they_hold() {
        for len in [1, 7, 8, 97, 20_000] {
            let mut column: AlignedColumn = (0..len).map(|i| i as f64).collect();
            column.resize(len + 9, -1.0);
            let copy = column.clone();
            for c in [&column, &copy, &AlignedColumn::zeros(len)] {
                assert_eq!(c.as_ptr() as usize % LINE, 0);
            }
            assert!((0..len).all(|i| copy[i] == i as f64) && copy[len..] == [-1.0; 9]);
        }
    }
}
