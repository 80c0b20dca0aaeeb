//! The ellipsoid WGS 84.
//!
//! Sines and cosines are those of `libm`, which every machine computes alike.

/// Half axes in metres, the last one towards the pole.
pub const HALF_AXES: [f64; 3] = [SEMI_MAJOR, SEMI_MAJOR, 6_356_752.314_245_179];

/// Half the longer axis in metres, and the square of the eccentricity.
const SEMI_MAJOR: f64 = 6_378_137.0;
const ECCENTRICITY_SQUARED: f64 = 0.006_694_379_990_141_316;

/// Metres of a degree of longitude and of latitude at a latitude.
pub(crate) fn metres_of_degree(latitude: f64) -> [f64; 2] {
    let sine = libm::sin(latitude.clamp(-90.0, 90.0).to_radians());
    let rest = 1.0 - ECCENTRICITY_SQUARED * sine * sine;
    let across = SEMI_MAJOR / rest.sqrt() * (1.0 - sine * sine).sqrt();
    let along = SEMI_MAJOR * (1.0 - ECCENTRICITY_SQUARED) / (rest * rest.sqrt());
    [across, along].map(f64::to_radians)
}

/// Where a place of this longitude and latitude in degrees and height in metres lies, in metres from
/// the middle of the Earth: towards longitude 0 and 90 degrees on the equator, and towards the pole.
///
/// ```
/// let [x, y, z] = pixmesh_terrain::earth_centered([90.0, 0.0, 100.0]);
/// assert!(x.abs() < 1e-6 && (y - 6_378_237.0).abs() < 1e-6 && z == 0.0);
/// ```
#[must_use]
pub fn earth_centered([longitude, latitude, height]: [f64; 3]) -> [f64; 3] {
    let (sin_east, cos_east) = libm::sincos(longitude.to_radians());
    let (sin_north, cos_north) = libm::sincos(latitude.to_radians());
    let across = SEMI_MAJOR / (1.0 - ECCENTRICITY_SQUARED * sin_north * sin_north).sqrt();
    let from_axis = (across + height) * cos_north;
    let along_axis = (across * (1.0 - ECCENTRICITY_SQUARED) + height) * sin_north;
    [from_axis * cos_east, from_axis * sin_east, along_axis]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_without_height_lie_on_the_ellipsoid() {
        for (longitude, latitude) in [(0.0, 0.0), (12.5, 48.1), (-170.0, -89.0), (33.0, 90.0)] {
            let place = earth_centered([longitude, latitude, 0.0]);
            let sum: f64 = place.iter().zip(HALF_AXES).map(|(p, axis)| (p / axis).powi(2)).sum();
            assert!((sum - 1.0).abs() < 1e-14, "{longitude}, {latitude}: {sum}");
            let above = earth_centered([longitude, latitude, 250.0]);
            let height: f64 = above.iter().zip(place).map(|(a, b)| (a - b).powi(2)).sum();
            assert!((height.sqrt() - 250.0).abs() < 1e-8);
        }
    }
}
