//! Arrays in huge pages: trees that are larger than the cache miss the translation of addresses as often as the data.

use bytemuck::Pod;
use core::ops::Deref;
use memmap2::MmapMut;

/// From this size on (bytes) huge pages are asked for: the size of one on x86-64.
const HUGE: usize = 2 << 20;

/// An array that does not change, in huge pages where it is large and the system has them.
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

impl<T: Pod> From<Vec<T>> for HugeArray<T> {
    fn from(items: Vec<T>) -> Self {
        let bytes: &[u8] = bytemuck::cast_slice(&items);
        if bytes.len() < HUGE || align_of::<T>() > 4096 {
            return HugeArray::Small(items);
        }
        let Ok(mut pages) = MmapMut::map_anon(bytes.len()) else { return HugeArray::Small(items) };
        // A wish: without huge pages the array works as well.
        #[cfg(target_os = "linux")]
        let _ = pages.advise(memmap2::Advice::HugePage);
        pages[..bytes.len()].copy_from_slice(bytes);
        HugeArray::Mapped { len: items.len(), pages }
    }
}

impl<T: Pod> Deref for HugeArray<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            HugeArray::Small(items) => items,
            HugeArray::Mapped { pages, len } => {
                // SAFETY: the pages hold `len` elements, copied there from such elements, and begin on the boundary
                // of a page, which is a multiple of the alignment.
                unsafe { core::slice::from_raw_parts(pages.as_ptr().cast(), *len) }
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
            let array = HugeArray::from(items.clone());
            assert_eq!(*array, items[..]);
            assert_eq!(matches!(array, HugeArray::Mapped { .. }), 8 * n >= HUGE);
        }
    }
}
