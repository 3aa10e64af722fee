//! Memory that begins on cache lines, for columns that are read a line at a time.

use std::alloc::{GlobalAlloc, Layout, System};

/// The system's allocator, with everything of the size of a column at the beginning of a cache line. What it usually returns lies
/// 16 bytes off, so that every load of a wide vector unit touches two lines: bush-20-40 takes 12 to 14 % longer so (AVX-512).
/// (Vectors with an alignment of their own, as in `aligned-vec`, would make every column of a State another type.)
pub struct LineAligned;

const LINE: usize = 64;
/// Columns of 32 to 16,384 links [bytes]; what is larger grows in place better than it is copied.
const COLUMNS: std::ops::RangeInclusive<usize> = 256..=131_072;

/// The layout that is asked of the system: depends on nothing but the layout that is asked of us.
fn lined(layout: Layout) -> Layout {
    if !COLUMNS.contains(&layout.size()) {
        return layout;
    }
    // A size that cannot be rounded up to a line is outside the range.
    layout.align_to(LINE).unwrap_or(layout)
}

// SAFETY: every block is asked of the system, and given back to it, with the same layout `lined` of the same one.
unsafe impl GlobalAlloc for LineAligned {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: `lined` keeps the size, which the caller guarantees is not zero.
        unsafe { System.alloc(lined(layout)) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(lined(layout)) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the block was asked for with this layout.
        unsafe { System.dealloc(block, lined(layout)) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller guarantees a size that makes a layout with this alignment.
        let wanted = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        if lined(layout).align() == layout.align() && lined(wanted).align() == wanted.align() {
            // SAFETY: the system knows the block by this layout, and would have been asked for the new one like this.
            return unsafe { System.realloc(block, layout, size) };
        }
        // SAFETY: both blocks are as long as what is copied, and different.
        unsafe {
            let new = self.alloc(wanted);
            if !new.is_null() {
                std::ptr::copy_nonoverlapping(block, new, layout.size().min(size));
                self.dealloc(block, layout);
            }
            new
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_begin_on_lines_and_keep_what_they_hold() {
        let heap = LineAligned;
        for first in [8_usize, 255, 256, 776, 131_072, 131_073] {
            for then in [16_usize, 255, 256, 1000, 131_072, 200_000] {
                let layout = Layout::from_size_align(first, 8).expect("a layout");
                // SAFETY: the sizes are not zero, and each block is used within its size and given back once.
                unsafe {
                    let block = heap.alloc(layout);
                    block.write_bytes(0x5a, first);
                    let block = heap.realloc(block, layout, then);
                    assert_eq!(block as usize % if COLUMNS.contains(&then) { LINE } else { 8 }, 0);
                    assert!((0..first.min(then)).all(|i| *block.add(i) == 0x5a));
                    heap.dealloc(block, Layout::from_size_align(then, 8).expect("a layout"));
                }
            }
        }
    }
}
