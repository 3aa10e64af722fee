//! Blocks of lanes: columns are worked on in blocks of [`LANES`] values, which live in vector registers.

/// Lanes that are computed together: arrays of a fixed size, so that they live in vector registers.
pub const LANES: usize = 8;

/// One value per lane.
pub type LaneBlock = [f64; LANES];

/// A yes or a no per lane, as wide as a value, so that it lives in vector registers too: all bits or none.
pub type LaneMask = [u64; LANES];

/// One lane of a [`LaneMask`].
#[inline(always)]
pub fn mask(yes: bool) -> u64 {
    if yes { u64::MAX } else { 0 }
}

/// Whether any lane says yes.
#[inline(always)]
pub fn any(lanes: &LaneMask) -> bool {
    lanes.iter().fold(0, |any, lane| any | lane) != 0
}

/// One block of values from `at`.
#[inline(always)]
pub fn take(column: &[f64], at: usize) -> LaneBlock {
    let mut out = [0.0; LANES];
    out.copy_from_slice(&column[at..at + LANES]);
    out
}

/// The first blocks of a column: slices of one length, so that one bounds check does for a loop over many of them.
#[inline(always)]
pub fn blocks(column: &[f64], count: usize) -> &[LaneBlock] {
    &column.as_chunks::<LANES>().0[..count]
}

#[inline(always)]
pub fn blocks_mut(column: &mut [f64], count: usize) -> &mut [LaneBlock] {
    &mut column.as_chunks_mut::<LANES>().0[..count]
}
