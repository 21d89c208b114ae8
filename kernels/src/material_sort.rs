//! Stage `material_sort`: a counting sort of the paths by what they met. It is also the compaction: paths that ended
//! are in no list of a shade kernel.

use crate::isa::{Isa, Kernel};
use crate::queue::{HitQueue, OrderLists, PathQueue, SLOT_BITS};
use crate::scene::{MISS, MaterialClass, PrimitiveTag};

/// Number of lists: the material classes, and after them those of [`list`].
pub const LISTS: usize = MaterialClass::COUNT + 2;

/// Lists beside those of the material classes.
pub mod list {
    use crate::scene::MaterialClass;
    /// Paths at their last vertex, or on a surface that reflects nothing: they end after their emission was added.
    pub const ENDED: usize = MaterialClass::COUNT;
    /// Paths that left the scene.
    pub const MISSED: usize = MaterialClass::COUNT + 1;
}

/// Where each list begins and ends in [`OrderLists::sorted`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sorted {
    /// List `k` is `sorted[starts[k]..starts[k + 1]]`.
    pub starts: [usize; LISTS + 1],
    /// Places in [`OrderLists::emitting`].
    pub emitting: usize,
}

impl Sorted {
    /// Places of list `k`.
    #[inline(always)]
    pub fn range(&self, k: usize) -> core::ops::Range<usize> {
        self.starts[k]..self.starts[k + 1]
    }
}

/// The kernel.
pub struct MaterialSort<'a> {
    /// [`crate::scene::Geometry::tags`].
    pub tags: &'a [u32],
    /// Longest path.
    pub max_depth: u32,
    /// The paths.
    pub paths: &'a PathQueue,
    /// Where they arrived.
    pub hits: &'a HitQueue,
    /// Receives the lists.
    pub order: &'a mut OrderLists,
}

impl Kernel for MaterialSort<'_> {
    type Output = Sorted;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> Sorted {
        material_sort(self.tags, self.max_depth, self.paths, self.hits, self.order)
    }
}

/// Which list a path belongs to, and whether its primitive emits.
///
/// An absorber is as good as the last vertex.
#[inline(always)]
pub fn list_of(tags: &[u32], max_depth: u32, primitive: u32, depth: u32) -> (usize, bool) {
    if primitive == MISS {
        return (list::MISSED, false);
    }
    let tag = PrimitiveTag(tags[primitive as usize]);
    let ended = depth >= max_depth || tag.class() == MaterialClass::Absorber as u32;
    (if ended { list::ENDED } else { tag.class() as usize }, tag.emits())
}

#[inline(always)]
fn material_sort(
    tags: &[u32],
    max_depth: u32,
    paths: &PathQueue,
    hits: &HitQueue,
    order: &mut OrderLists,
) -> Sorted {
    let n = paths.len;
    let mut counts = [0usize; 16];
    let mut emitting = 0;
    // First pass: keys, into the list of free slots' neighbour: `finished` is empty here and serves as scratch.
    let keys = &mut order.finished[..n];
    for (i, key) in keys.iter_mut().enumerate() {
        let (list, emits) = list_of(tags, max_depth, hits.primitive[i], paths.slot_depth[i] >> SLOT_BITS);
        *key = list as u32;
        counts[list & 15] += 1;
        order.emitting[emitting] = i as u32;
        emitting += emits as usize;
    }
    let mut sorted = Sorted { emitting, ..Sorted::default() };
    let mut cursor = [0usize; 16];
    for k in 0..LISTS {
        cursor[k] = sorted.starts[k];
        sorted.starts[k + 1] = sorted.starts[k] + counts[k];
    }
    let out = &mut order.sorted[..n];
    for (i, &key) in keys.iter().enumerate() {
        let at = &mut cursor[key as usize & 15];
        out[*at] = i as u32;
        *at += 1;
    }
    sorted
}
