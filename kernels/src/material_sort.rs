//! Stage `material_sort`: a counting sort of the paths by what they met. It is also the compaction: paths that ended
//! are in no list of a shade kernel.

use crate::isa::{Isa, Kernel};
use crate::queue::{HitQueue, OrderLists, PathQueue, SLOT_BITS};
use crate::scene::{MISS, MaterialClass, PrimitiveTag};

/// Number of lists: the material classes, and after them those of [`list`].
pub const LISTS: usize = MaterialClass::COUNT + 2;

/// Numbers of the lists. Those of paths that end come first: beside the free slots, which theirs are to join.
pub mod list {
    use crate::scene::MaterialClass;
    /// Paths that left the scene.
    pub const MISSED: usize = 0;
    /// Paths at their last vertex, or on a surface that reflects nothing: they end after their emission was added.
    pub const ENDED: usize = 1;
    const FIRST_CLASS: usize = super::LISTS - MaterialClass::COUNT;
    /// Paths to be scattered by a material.
    #[inline(always)]
    pub const fn of(class: MaterialClass) -> usize {
        of_number(class as u32)
    }
    #[inline(always)]
    pub(super) const fn of_number(class: u32) -> usize {
        FIRST_CLASS + class as usize
    }
    /// The class whose list this is; none for [`MISSED`] and [`ENDED`].
    #[inline(always)]
    pub const fn class(list: usize) -> Option<MaterialClass> {
        if list < FIRST_CLASS { None } else { Some(MaterialClass::ALL[list - FIRST_CLASS]) }
    }
}

/// Bit of [`OrderLists::key`] of paths whose primitive emits; the others hold the number of the list.
pub const EMITS: u8 = 0x80;

/// Room for a number a list: a power of two, so that indices need no check.
const BUCKETS: usize = LISTS.next_power_of_two();

/// Where each list begins and ends in [`OrderLists::list`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sorted {
    /// List `k` is `list[starts[k]..starts[k + 1]]`.
    pub starts: [usize; LISTS + 1],
    /// Number of paths whose primitive emits.
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
    /// Receives the lists, behind the free slots.
    pub order: &'a mut OrderLists,
    /// Number of free slots.
    pub free: usize,
}

impl Kernel for MaterialSort<'_> {
    type Output = Sorted;
    #[inline(always)]
    fn run<I: Isa>(self, _isa: I) -> Sorted {
        let MaterialSort { tags, max_depth, paths, hits, order, free } = self;
        // Of mixtures, the hits know what was chosen.
        if hits.material.is_empty() {
            material_sort::<false>(tags, max_depth, paths, hits, order, free)
        } else {
            material_sort::<true>(tags, max_depth, paths, hits, order, free)
        }
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
    (list_of_class(max_depth, tag.class(), depth), tag.emits())
}

/// Which list a path belongs to that met a material of this class.
#[inline(always)]
pub fn list_of_class(max_depth: u32, class: u32, depth: u32) -> usize {
    let ended = depth >= max_depth || class == MaterialClass::Absorber as u32;
    if ended { list::ENDED } else { list::of_number(class) }
}

#[inline(always)]
fn material_sort<const MIXES: bool>(
    tags: &[u32],
    max_depth: u32,
    paths: &PathQueue,
    hits: &HitQueue,
    order: &mut OrderLists,
    free: usize,
) -> Sorted {
    let n = paths.len;
    let mut counts = [0usize; BUCKETS];
    let mut emitting = 0;
    let keys = &mut order.key[..n];
    for (i, key) in keys.iter_mut().enumerate() {
        let depth = paths.slot_depth[i] >> SLOT_BITS;
        let (mut list, emits) = list_of(tags, max_depth, hits.primitive[i], depth);
        if MIXES && list != list::MISSED {
            list = list_of_class(max_depth, PrimitiveTag(hits.material[i]).class(), depth);
        }
        *key = list as u8 | if emits { EMITS } else { 0 };
        counts[list & (BUCKETS - 1)] += 1;
        emitting += emits as usize;
    }
    let mut sorted = Sorted { emitting, ..Sorted::default() };
    let mut cursor = [0usize; BUCKETS];
    sorted.starts[0] = free;
    for k in 0..LISTS {
        cursor[k] = sorted.starts[k];
        sorted.starts[k + 1] = sorted.starts[k] + counts[k];
    }
    let out = &mut order.list[..free + n];
    for (i, &key) in keys.iter().enumerate() {
        let at = &mut cursor[key as usize & (BUCKETS - 1)];
        out[*at] = i as u32;
        *at += 1;
    }
    sorted
}
