//! The error of faces: how far their interpolants are from the picture.

use crate::error_metric::Metric;
use crate::face_rows::for_each_row;
use crate::image::Image;
use crate::interpolant::Interpolant;
use crate::mesh::Point;
use crate::method::ErrorMetric;
use crate::predicates::orientation;

/// Computes errors of faces over vertices at lattice points of an image; keeps its memory from one
/// face to the next.
pub(crate) struct FaceErrors<'a> {
    image: &'a Image,
    /// `None` for the squared error, which has a path of its own.
    metric: Option<&'static dyn Metric>,
    interpolants: Vec<Interpolant>,
    /// One row of approximations for each component.
    approximations: Vec<Vec<u16>>,
}

impl<'a> FaceErrors<'a> {
    /// Errors of approximations of `image` by a metric.
    pub(crate) fn new(image: &'a Image, metric: ErrorMetric) -> Self {
        let count = image.component_count();
        Self {
            image,
            metric: (!metric.is_squared_difference()).then(|| metric.metric()),
            interpolants: Vec::with_capacity(count),
            approximations: vec![Vec::new(); count],
        }
    }

    /// Sum over the face's lattice points of the error of the rounded interpolant.
    #[inline]
    pub(crate) fn error(&mut self, corners: [Point; 3]) -> u64 {
        self.prepare(corners);
        match self.metric {
            None => self.squared_error(corners),
            Some(metric) => self.error_by(metric, corners),
        }
    }

    /// Sets the interpolants of a face.
    #[inline]
    fn prepare(&mut self, corners: [Point; 3]) {
        let width = self.image.width();
        let places = corners.map(|p| p.y as usize * width + p.x as usize);
        let double_area = orientation(corners[0], corners[1], corners[2]);
        let quarter_reciprocal = 0.25 / double_area as f64;
        self.interpolants.clear();
        self.interpolants.extend(self.image.components().iter().map(|samples| {
            let samples = places.map(|place| samples[place]);
            Interpolant::with_double_area(corners, samples, double_area, quarter_reciprocal)
        }));
    }

    /// Sum over points and components of the squared differences.
    #[inline]
    fn squared_error(&self, corners: [Point; 3]) -> u64 {
        let (image, width) = (self.image, self.image.width());
        let mut sum = 0;
        for_each_row(corners, |y, first, end| {
            let points = y as usize * width + first as usize..y as usize * width + end as usize;
            for (interpolant, samples) in self.interpolants.iter().zip(image.components()) {
                sum += interpolant.squared_error(first, y, &samples[points.clone()]);
            }
        });
        sum
    }

    /// Sum over points of another metric.
    fn error_by(&mut self, metric: &dyn Metric, corners: [Point; 3]) -> u64 {
        let Self { image, interpolants, approximations, .. } = self;
        let mut sum = 0;
        for_each_row(corners, |y, first, end| {
            let columns = first as usize..end as usize;
            for (interpolant, row) in interpolants.iter().zip(approximations.iter_mut()) {
                row.resize(columns.len(), 0);
                interpolant.fill(first, y, row);
            }
            let components = 0..image.component_count();
            let original: Vec<&[u16]> =
                components.map(|c| &image.row(c, y as usize)[columns.clone()]).collect();
            sum += metric.error(&original, approximations);
        });
        sum
    }
}
