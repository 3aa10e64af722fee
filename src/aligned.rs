//! Memory allocator that aligns columns to cache lines, because they are read one line at a time.

use std::alloc::{GlobalAlloc, Layout, System};

/// The system's allocator, with allocations of the size of a column aligned to a cache line. Its usual alignment is 16
/// bytes off, so that every load of a wide vector unit touches two lines: bush-20-40 takes 12 to 14 % longer that way
/// (AVX-512). (Vectors with their own alignment, as in `aligned-vec`, would give every column of a State another type.)
pub struct LineAligned;

const LINE: usize = 64;
/// Columns of 32 to 16,384 links [bytes]; larger blocks are better grown in place than copied.
const COLUMNS: std::ops::RangeInclusive<usize> = 256..=131_072;

/// The layout requested from the system, which depends only on the layout requested by the caller.
fn line_aligned(layout: Layout) -> Layout {
    if !COLUMNS.contains(&layout.size()) {
        return layout;
    }
    // A size that cannot be rounded up to a line is outside the range.
    layout.align_to(LINE).unwrap_or(layout)
}

// SAFETY: every block is requested from the system and returned to it with the same layout, `line_aligned` of the same layout.
unsafe impl GlobalAlloc for LineAligned {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: `line_aligned` keeps the size, which the caller guarantees is not zero.
        unsafe { System.alloc(line_aligned(layout)) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(line_aligned(layout)) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the block was requested with this layout.
        unsafe { System.dealloc(block, line_aligned(layout)) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller guarantees a size that makes a layout with this alignment.
        let wanted = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        if line_aligned(layout).align() == layout.align() && line_aligned(wanted).align() == wanted.align() {
            // SAFETY: the system knows the block by this layout, and would have been given the new one in the same way.
            return unsafe { System.realloc(block, layout, size) };
        }
        // SAFETY: both blocks have at least the copied length, and they are different.
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
