//! Tests that pin tuning: sums, numbers of polls, counts of passes.
//!
//! A change of the tuning may change the numbers in this file. The tests of behaviour stand beside
//! the code.

mod refinement {
    use crate::control::tests::poller;
    use crate::face_error::tests::evaluator_of;
    use crate::image::{Image, Point, corner_points};
    use crate::refinement::refine;
    use crate::refinement::tests::{measured, shaded};
    use std::collections::BTreeSet;

    /// 104 points of a picture of 64 columns and rows, the corners among them.
    fn scattered() -> Vec<Point> {
        let seeds = (0..100).map(|i| Point::new(i % 10 * 6 + i / 10 % 2 * 3 + 2, i / 10 * 6 + 3));
        let points: BTreeSet<Point> = seeds.chain(corner_points(64, 64)).collect();
        points.into_iter().collect()
    }

    #[test]
    fn errors_of_each_effort() {
        let image = shaded(64);
        let measure = evaluator_of(&image);
        let errors: Vec<u64> = (0..=9)
            .map(|effort| {
                let mut mesh = measured(&measure, &image, scattered());
                refine(&mut mesh, effort, &()).unwrap();
                mesh.triangulation.total_error
            })
            .collect();
        assert_eq!(
            errors,
            [2110560, 777730, 728808, 710800, 702910, 698338, 694192, 688308, 685670, 679298]
        );
    }

    #[test]
    fn errors_of_twelve_bits() {
        let shaded = shaded(64);
        let finer = |samples: &Vec<u16>| {
            samples.iter().enumerate().map(|(i, sample)| sample * 16 + (i % 7) as u16).collect()
        };
        let components = shaded.components().iter().map(finer).collect();
        let image = Image::from_bottom_up(64, 64, 12, components).unwrap();
        let errors = [true, false].map(|has_model| {
            let evaluator = evaluator_of(&image);
            let measure =
                if has_model { evaluator.with_model(&mut poller()).unwrap() } else { evaluator };
            let mut mesh = measured(&measure, &image, scattered());
            refine(&mut mesh, 1, &()).unwrap();
            mesh.triangulation.total_error
        });
        assert_eq!(errors, [209_397_316, 200_138_860]);
    }
}
