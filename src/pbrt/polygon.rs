//! Faces with more than three corners: plane polygons are cut into triangles, reflex corners included; quads that are not
//! plane are bilinear patches, as in pbrt-v4, and become grids of triangles.

use earcut::Earcut;
use glam::DVec3;

/// Distance of a polygon's corners from its plane, relative to its size, up to which it counts as plane.
const PLANAR: f64 = 1e-4;

/// Most corners of a face. Cutting takes longer than in proportion to them.
const MAX_CORNERS: usize = 1 << 16;

/// Twice the area of a polygon, with the direction of its normal (Newell's method).
fn newell(corners: &[DVec3]) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for i in 1..corners.len().saturating_sub(1) {
        sum += (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]);
    }
    sum
}

/// Largest distance of a corner from the first.
fn extent(corners: &[DVec3]) -> f64 {
    corners.iter().map(|p| (*p - corners[0]).length()).fold(0.0, f64::max)
}

fn is_plane(corners: &[DVec3], unit: DVec3, size: f64) -> bool {
    let mean = corners.iter().sum::<DVec3>() / corners.len() as f64;
    corners.iter().all(|p| (*p - mean).dot(unit).abs() <= PLANAR * size)
}

fn is_convex(corners: &[DVec3], unit: DVec3, size: f64) -> bool {
    let n = corners.len();
    let edge = |i: usize| corners[(i + 1) % n] - corners[i % n];
    let mut turns = 0.0;
    for i in 0..n {
        let (a, b) = (edge(i), edge(i + 1));
        let sine = a.cross(b).dot(unit);
        if sine < -PLANAR * size * size {
            return false;
        }
        turns += sine.atan2(a.dot(b));
    }
    // Once around; a star turns twice.
    turns < 1.5 * std::f64::consts::TAU
}

/// Whether four corners, in order around, are a plane convex quadrilateral.
pub(crate) fn is_plane_and_convex(corners: [DVec3; 4]) -> bool {
    let size = extent(&corners);
    // Relative to the size, so that the squares of tiny ones do not underflow.
    let corners = corners.map(|p| (p - corners[0]) / size);
    let Some(unit) = newell(&corners).try_normalize() else {
        return false;
    };
    is_plane(&corners, unit, 1.0) && is_convex(&corners, unit, 1.0)
}

/// Cuts a plane polygon into triangles of its corners' numbers. `None` if it is not plane, crosses itself, or has no area.
pub(crate) fn triangulate(corners: &[DVec3]) -> Option<Vec<[u32; 3]>> {
    if corners.len() < 3 || corners.len() > MAX_CORNERS {
        return None;
    }
    let size = extent(corners);
    let corners: Vec<DVec3> = corners.iter().map(|p| (*p - corners[0]) / size).collect();
    let unit = newell(&corners).try_normalize()?;
    if !is_plane(&corners, unit, 1.0) {
        return None;
    }
    if is_convex(&corners, unit, 1.0) {
        return Some((1..corners.len() as u32 - 1).map(|i| [0, i, i + 1]).collect());
    }
    let (x, y) = unit.any_orthonormal_pair();
    let flat: Vec<[f64; 2]> = corners.iter().map(|p| [p.dot(x), p.dot(y)]).collect();
    let mut indices: Vec<u32> = Vec::new();
    Earcut::new().earcut_slice(&flat, &[], &mut indices);
    let triangles: Vec<[u32; 3]> = indices.as_chunks::<3>().0.to_vec();
    // As large as the polygon: less would be holes, more would be overlaps.
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| corners[i as usize]);
        (b - a).cross(c - a).length()
    };
    let (found, expected) = (triangles.iter().map(area).sum::<f64>(), newell(&corners).length());
    if (found - expected).abs() > 1e-6 * found.max(expected) {
        return None;
    }
    // In the polygon's own sense of rotation.
    let turned = |t: [u32; 3]| {
        let [a, b, c] = t.map(|i| corners[i as usize]);
        if (b - a).cross(c - a).dot(unit) < 0.0 { [t[0], t[2], t[1]] } else { t }
    };
    Some(triangles.into_iter().map(turned).collect())
}

/// Distance between a patch and its triangles, relative to its size.
const PATCH_TOLERANCE: f64 = 5e-4;

/// Most pieces along a side of a patch.
const MAX_PIECES: u32 = 64;

/// Into how many pieces the sides of a bilinear patch are cut. Corners in the order 00, 10, 01, 11.
///
/// The patch differs from a parallelogram by its twist p00 - p10 - p01 + p11; a piece of n along each side has that over
/// n^2, and a fourth of it lies between its middle and the diagonal at which it is cut.
pub(crate) fn pieces([p00, p10, p01, p11]: [DVec3; 4]) -> u32 {
    let size = extent(&[p00, p10, p01, p11]);
    let twist = (p00 - p10 - p01 + p11).length();
    if size <= 0.0 || !size.is_finite() {
        return 1;
    }
    ((twist / (4.0 * PATCH_TOLERANCE * size)).sqrt().ceil() as u32).clamp(1, MAX_PIECES)
}

/// Bilinear interpolation, corners in the order 00, 10, 01, 11.
pub(crate) fn bilinear<const N: usize>([p00, p10, p01, p11]: [[f64; N]; 4], u: f64, v: f64) -> [f64; N] {
    std::array::from_fn(|i| {
        (1.0 - v) * ((1.0 - u) * p00[i] + u * p10[i]) + v * ((1.0 - u) * p01[i] + u * p11[i])
    })
}

/// Normal of a bilinear patch, not of unit length: the product of its derivatives by u and v.
pub(crate) fn patch_normal([p00, p10, p01, p11]: [DVec3; 4], u: f64, v: f64) -> DVec3 {
    let by_u = (1.0 - v) * (p10 - p00) + v * (p11 - p01);
    let by_v = (1.0 - u) * (p01 - p00) + u * (p11 - p10);
    by_u.cross(by_v)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|p| DVec3::new(p[0], p[1], 2.0)).collect()
    }

    fn area(corners: &[DVec3]) -> Option<f64> {
        let of = |t: [u32; 3]| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            0.5 * (b - a).cross(c - a).z
        };
        Some(triangulate(corners)?.into_iter().map(of).sum())
    }

    #[test]
    fn polygons_are_cut_into_their_own_area() {
        let l = plane(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]);
        let dart = plane(&[[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]]);
        let hexagon: Vec<[f64; 2]> =
            (0..6).map(|i| f64::from(i) * std::f64::consts::FRAC_PI_3).map(|a| [a.cos(), a.sin()]).collect();
        for (corners, expected) in [(l, 3.0), (dart, 0.5), (plane(&hexagon), 1.5 * 3f64.sqrt())] {
            for start in 0..corners.len() {
                let mut turned = corners.clone();
                turned.rotate_left(start);
                assert!((area(&turned).unwrap() - expected).abs() < 1e-12, "{turned:?}");
                turned.reverse();
                assert!((area(&turned).unwrap() + expected).abs() < 1e-12, "{turned:?}");
            }
            let far: Vec<DVec3> = corners.iter().map(|p| *p * 1e-20).collect();
            assert!(triangulate(&far).is_some());
        }
    }

    #[test]
    fn what_is_no_plane_polygon_is_not_cut() {
        let bow = plane(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 2.0]]);
        let star: Vec<[f64; 2]> = (0..5)
            .map(|i| f64::from(i) * 2.0 * std::f64::consts::TAU / 5.0)
            .map(|a| [a.cos(), a.sin()])
            .collect();
        let line = plane(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [4.0, 0.0]]);
        let mut bent = plane(&[[0.0, 0.0], [1.0, 0.0], [1.5, 0.5], [1.0, 1.0], [0.0, 1.0]]);
        assert!(triangulate(&bent).is_some());
        bent[0].z += 0.1;
        for corners in [bow, plane(&star), line, bent, vec![DVec3::ONE; 5], plane(&[[0.0, 0.0], [1.0, 0.0]])]
        {
            assert!(triangulate(&corners).is_none(), "{corners:?}");
        }
    }

    #[test]
    fn plane_quads_are_told_from_others() {
        let quad = |points: [[f64; 3]; 4]| is_plane_and_convex(points.map(DVec3::from_array));
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(quad(square));
        assert!(quad(square.map(|p| p.map(|c| c * 1e-20))));
        let mut bent = square;
        bent[2][2] = 0.1;
        assert!(!quad(bent));
        let mut dented = square;
        dented[2] = [0.2, 0.2, 0.0];
        assert!(!quad(dented));
        assert!(!quad([square[0], square[2], square[1], square[3]]));
        // A triangle written as a quad.
        assert!(quad([square[0], square[1], square[2], square[2]]));
    }

    #[test]
    fn patches_are_cut_finely_enough() {
        let corners = [[-1.0, -1.0, 0.6], [1.0, -1.0, -0.6], [-1.0, 1.0, -0.6], [1.0, 1.0, 0.6]];
        let points = corners.map(DVec3::from_array);
        let n = pieces(points);
        let at = |i: u32, j: u32| {
            DVec3::from_array(bilinear(corners, f64::from(i) / f64::from(n), f64::from(j) / f64::from(n)))
        };
        // In the middle of the diagonal of a piece, half way between its corners and on the patch.
        let middle = DVec3::from_array(bilinear(corners, 0.5 / f64::from(n), 0.5 / f64::from(n)));
        let gap = (0.5 * (at(0, 0) + at(1, 1)) - middle).length();
        assert!(gap < 1e-3 * 3.2 && n > 4, "{gap}, {n} pieces");
        assert_eq!(
            pieces([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]].map(DVec3::from_array)),
            1
        );
        // z = 0.6 x y: the normal is (-0.6 y, -0.6 x, 1).
        let normal = patch_normal(points, 0.75, 0.5).normalize();
        assert!((normal - DVec3::new(0.0, -0.3, 1.0).normalize()).length() < 1e-12, "{normal}");
    }
}
