//! Arrays in huge pages: trees that are larger than the cache miss the translation of addresses as often as the data.

use bytemuck::Pod;
use core::ops::{Deref, DerefMut};
use memmap2::MmapMut;

/// From this size on (bytes) huge pages are asked for: the size of one on x86-64.
const HUGE: usize = 2 << 20;

/// An array of fixed size, in huge pages where it is large and the system has them.
#[derive(Debug)]
pub enum HugeArray<T> {
    /// Small, or there are none.
    Small(Vec<T>),
    /// Mapped.
    Mapped {
        /// The pages, which begin on the boundary of a page.
        pages: MmapMut,
        /// Elements.
        len: usize,
    },
}

impl<T: Pod> HugeArray<T> {
    /// `len` zeros.
    pub fn zeroed(len: usize) -> Self {
        let small = || HugeArray::Small(vec![T::zeroed(); len]);
        let bytes = len.saturating_mul(size_of::<T>());
        if bytes < HUGE || align_of::<T>() > 4096 {
            return small();
        }
        let Ok(pages) = MmapMut::map_anon(bytes) else { return small() };
        // A wish: without huge pages the array works as well.
        #[cfg(target_os = "linux")]
        let _ = pages.advise(memmap2::Advice::HugePage);
        HugeArray::Mapped { len, pages }
    }
}

impl<T: Pod> Deref for HugeArray<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            HugeArray::Small(items) => items,
            HugeArray::Mapped { pages, len } => {
                // SAFETY: the pages hold `len` elements, of a type that may hold any bits, and begin on the boundary
                // of a page, which is a multiple of the alignment.
                unsafe { core::slice::from_raw_parts(pages.as_ptr().cast(), *len) }
            }
        }
    }
}

impl<T: Pod> DerefMut for HugeArray<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            HugeArray::Small(items) => items,
            HugeArray::Mapped { pages, len } => {
                // SAFETY: as above, and the pages are borrowed as a whole.
                unsafe { core::slice::from_raw_parts_mut(pages.as_mut_ptr().cast(), *len) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_what_it_was_given() {
        for n in [0usize, 1, 1000, 300_001, 1 << 20] {
            let items: Vec<u64> = (0..n as u64).map(|i| i * i).collect();
            let mut array = HugeArray::<u64>::zeroed(n);
            assert!(array.iter().all(|&item| item == 0));
            array.copy_from_slice(&items);
            assert_eq!(*array, items[..]);
            assert_eq!(matches!(array, HugeArray::Mapped { .. }), 8 * n >= HUGE);
        }
    }
}
