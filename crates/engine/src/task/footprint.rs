//! The memory that meshing takes at its peak, stage by stage.
//!
//! Each stage is charged for what it makes and for what lives beside it; the peak is the dearest
//! stage. The figures are the sizes of the buffers, and where a crate's own structures grow, what
//! a process was measured to take (`VmHWM`, one piece of work, pictures of 1 to 40 megapixels).
//! No sum overflows: sides are at most 2^20, so that pixels times bytes stay below 2^60.

use pixmesh_codec::{Format, Header, MeshHeader, read_model_bytes};
use pixmesh_meshing::parameters::{ErrorMetric, Generator, Guide, Parallel, Plan, Policy};
use pixmesh_meshing::{Parameters, Shape};

/// Bytes per sample of an image.
const SAMPLE: u64 = 2;
/// Bytes per pixel of a field of the density.
const FIELD: u64 = 8;
/// Bytes per pixel of the marks of chosen points: two for each of two threads while thresholds are
/// tried, one of the result.
const MARK: u64 = 5;
/// Bytes per pixel of the copy that faces are measured against: of one component, and of several.
const COPY_OF_ONE: u64 = 1;
const COPY_OF_SEVERAL: u64 = 4;
/// The most bits and components of a picture that is copied so.
const MAX_COPIED_BITS: u8 = 8;
const MAX_COPIED_COMPONENTS: u64 = 4;
/// Bytes per initial point: while they are triangulated, and later with what removal knows of each.
const POINT: u64 = 240;
/// Bytes per initial point more where they are removed tile by tile: their order in each tile, and what
/// goes in each round.
const TILED: u64 = 80;
/// Bytes per final vertex while it is refined: twice what is known of it and its faces.
const REFINED: u64 = 640;
/// Bytes that the allocator keeps apart for the threads that refine, eight at most, whatever the mesh.
const REFINING_THREADS: u64 = 32 << 20;
/// Bytes per inserted point: what is known of it and its faces, twice, and of those that wait.
const INSERTED: u64 = 1200;
/// Bytes per pixel of the marks of vertices while they are refined: in the mesh, as it was before a
/// round, and in patches.
const REFINED_MARKS: u64 = 3;
/// Bytes per sample of the running sums that flat faces are measured by, 16 each, and as much again
/// for what was measured beside them.
const ROW_SUMS: u64 = 32;
/// Bytes per column and component of the rows that the weights of the structural similarity come
/// from; the weights take a byte per pixel.
const WINDOW_ROWS: u64 = 14 * 2 * 8;
/// Bytes per initial point of the list of removed ones, kept to the end.
const REMOVAL: u64 = 16;
/// Bytes per final vertex with its two faces, in memory.
const VERTEX: u64 = 40;
/// Bytes per vertex of an order of vertices while it is made.
const ORDERED_VERTEX: u64 = 150;
/// Bytes per column of the rows that structural similarity keeps.
const COMPARED_ROWS: u64 = 13 * 5 * 8;
/// What the allocator keeps back, that of threads that have ended too: so much per pixel, and at most.
const SLACK_PER_PIXEL: u64 = 32;
const MAX_SLACK: u64 = 40 << 20;

/// What a picture is compared with.
#[derive(Clone, Copy, Debug)]
pub enum Compared<'a> {
    /// A picture of this header.
    Picture(&'a Header),
    /// A mesh file of this header and so many bytes.
    Mesh(&'a MeshHeader, u64),
}

/// What decides how much memory the meshing of an image takes.
pub(super) struct Footprint<'a> {
    header: &'a Header,
    parameters: &'a Parameters,
    format: Format,
    pixels: u64,
    components: u64,
    /// Points to start with.
    initial: u64,
    /// The most vertices to end with.
    most: u64,
    simplifies: bool,
}

impl<'a> Footprint<'a> {
    /// That of an image of this header and the plan that the parameters gave for it.
    pub(super) fn new(
        header: &'a Header,
        plan: &Plan,
        parameters: &'a Parameters,
        format: Format,
    ) -> Self {
        let initial = plan.initial_size as u64;
        // Where the error decides, any number of the initial points may stay.
        let most = if parameters.target.is_quality() { initial } else { plan.size as u64 };
        Self {
            header,
            parameters,
            format,
            pixels: header.width as u64 * header.height as u64,
            components: header.component_count as u64,
            initial,
            most,
            simplifies: parameters.simplifies(plan),
        }
    }

    /// Bytes at the dearest stage.
    pub(super) fn peak(&self) -> u64 {
        let stages = [
            self.header.decode_bytes(),
            self.choosing(),
            // The triangulation is gone before the mesh is written, but its memory is not yet given
            // back: both were measured to count.
            self.triangulating() + self.written(),
            self.ordering() + self.written(),
            self.encoding(),
        ];
        let slack = MAX_SLACK.min(self.pixels * SLACK_PER_PIXEL);
        stages.into_iter().max().unwrap_or_default() + slack
    }

    /// The image's samples.
    fn image(&self) -> u64 {
        image_bytes(self.header.shape())
    }

    /// The image, and per pixel what the choice of the initial points takes.
    fn choosing(&self) -> u64 {
        let chosen_from = match self.parameters.generator {
            _ if self.initial >= self.pixels => 0,
            Generator::ErrorDiffusion => self.density_per_pixel(),
            Generator::Insertion if self.inserts() => self.copy_per_pixel() + REFINED_MARKS,
            // The most, where the points are too many for a reduced picture.
            Generator::Insertion => FIELD,
            Generator::All | Generator::Random | Generator::Uniform => 0,
        };
        // Points within a largest error take less than the triangulation after them.
        let is_charged = self.inserts() && !self.parameters.inserts_within();
        let inserted = if is_charged { self.initial * INSERTED } else { 0 };
        self.image() + self.meshed_luma() + self.pixels * (MARK + chosen_from) + inserted
    }

    fn inserts(&self) -> bool {
        self.parameters.inserts(self.header.shape())
    }

    fn density_per_pixel(&self) -> u64 {
        match self.parameters.policy {
            Policy::PseD | Policy::PseL => FIELD * self.components,
            Policy::PsbD | Policy::PsbL => FIELD + SAMPLE,
            _ => FIELD,
        }
    }

    /// The image, what faces are measured by, and the triangulation of the initial points: during
    /// removal, and without it when the error is measured at the end.
    fn triangulating(&self) -> u64 {
        let measured_by = self.pixels * self.copy_per_pixel();
        let refining = match self.parameters.effort {
            0 => 0,
            _ => self.most * REFINED + self.pixels * REFINED_MARKS + REFINING_THREADS,
        };
        let point = match self.parameters.parallel {
            Parallel::Tiles => POINT + TILED,
            Parallel::Exact => POINT,
        };
        let meshing = refining.max(self.initial * point);
        let sums =
            if self.parameters.is_flat() { self.pixels * self.components * ROW_SUMS } else { 0 };
        let weights = match self.parameters.error_metric {
            ErrorMetric::Ssim => {
                self.pixels + self.header.width as u64 * self.components * WINDOW_ROWS
            }
            _ => 0,
        };
        self.image() + self.meshed_luma() + measured_by + meshing + sums + weights
    }

    /// The order of the mesh's vertices, where it is made: by removal down to the corners, followed
    /// once more where that does not tell the squared error.
    fn ordering(&self) -> u64 {
        if self.format != Format::Progression {
            return 0;
        }
        let measured_by = self.pixels * self.copy_per_pixel();
        let parameters = self.parameters;
        let tells_errors = parameters.error_metric == ErrorMetric::MeanCompSe
            && parameters.guide == Guide::Components;
        let (vertex, pixel) = if tells_errors { (POINT, 0) } else { (REFINED, REFINED_MARKS) };
        let working = self.most * vertex + self.pixels * pixel;
        let mesh = self.most * (VERTEX + ORDERED_VERTEX + SAMPLE * self.components);
        self.image() + self.meshed_luma() + measured_by + working + mesh
    }

    /// Pictures of few bits are measured against a copy with the samples of a point side by side; of
    /// others there is one of twice the bytes where moves are foreseen.
    fn copy_per_pixel(&self) -> u64 {
        let copy = match self.components {
            1 => COPY_OF_ONE,
            2..=MAX_COPIED_COMPONENTS => COPY_OF_SEVERAL,
            _ => 0,
        };
        match self.header.precision > MAX_COPIED_BITS {
            true if self.parameters.effort == 0 => 0,
            true => 2 * copy,
            false => copy,
        }
    }

    /// The luma, where it is meshed instead of the image.
    fn meshed_luma(&self) -> u64 {
        match self.parameters.guide {
            Guide::Luma | Guide::Gray => self.pixels * SAMPLE,
            Guide::Components => 0,
        }
    }

    /// The mesh, and the answer with what it is made from; the image is gone.
    fn encoding(&self) -> u64 {
        let of_faces = if self.parameters.is_flat() { 2 } else { 0 };
        let mesh = self.most * (VERTEX + SAMPLE * self.components * (1 + of_faces));
        let removals = if self.simplifies { self.initial * REMOVAL } else { 0 };
        let rebuilt_with_its_file = if self.format.is_picture() { 2 * self.image() } else { 0 };
        mesh + removals + self.written() + rebuilt_with_its_file
    }

    /// An answer that holds the mesh; a job keeps an order of vertices beside the MODEL.
    fn written(&self) -> u64 {
        let is_flat = self.parameters.is_flat();
        let kept = if self.format == Format::Progression {
            written(Format::Model, self.header.shape(), self.most, is_flat)
        } else {
            0
        };
        kept + written(self.format, self.header.shape(), self.most, is_flat)
    }
}

/// Bytes that writing a mesh of so many vertices takes, without those of a picture.
fn written(format: Format, shape: Shape, vertices: u64, is_flat: bool) -> u64 {
    vertices * format.bytes_per_vertex(shape.component_count, is_flat)
}

/// Bytes of an image's samples.
pub(crate) fn image_bytes(shape: Shape) -> u64 {
    shape.width as u64 * shape.height as u64 * shape.component_count as u64 * SAMPLE
}

/// Bytes that writing a mesh takes, the picture that it is rebuilt to with its file too.
fn written_or_rebuilt(format: Format, shape: Shape, vertices: u64, is_flat: bool) -> u64 {
    match format.is_picture() {
        true => 2 * image_bytes(shape),
        false => written(format, shape, vertices, is_flat),
    }
}

/// Bytes that reading a mesh file of a header takes, and writing its mesh of `size` vertices in a
/// format.
pub(super) fn of_conversion(header: &MeshHeader, file: u64, size: u64, format: Format) -> u64 {
    let MeshHeader { shape, is_flat, .. } = *header;
    let colored = if is_flat { image_bytes(shape) } else { 0 };
    let out = written_or_rebuilt(format, shape, size, is_flat);
    read_mesh(header, file, size).saturating_add(out).saturating_add(colored)
}

/// Bytes that reading a mesh file takes: as pmesh what is read of it, and the triangulation.
fn read_mesh(header: &MeshHeader, file: u64, size: u64) -> u64 {
    let MeshHeader { format, shape, vertices, is_flat, .. } = *header;
    if format == Format::Model {
        return read_model_bytes(file);
    }
    let read = written(format, shape, vertices as u64, is_flat);
    // Which points are vertices, a bit each, while they are read.
    let places = shape.width as u64 * shape.height as u64 / 4;
    file.saturating_add(read + places).saturating_add(size.saturating_mul(POINT + VERTEX))
}

/// Bytes that comparing a picture takes: both decoded, one after the other, and rows of sums.
pub(super) fn of_comparison(first: &Header, second: Compared<'_>) -> u64 {
    let second = match second {
        Compared::Picture(header) => header.decode_bytes(),
        Compared::Mesh(header, bytes) => {
            let read = read_mesh(header, bytes, header.vertices as u64);
            read.saturating_add(image_bytes(first.shape()))
        }
    };
    let rows = first.width as u64 * COMPARED_ROWS;
    first.decode_bytes().saturating_add(second).saturating_add(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_codec::PictureFormat;
    use pixmesh_meshing::parameters::InitialSize;
    use pixmesh_meshing::{MAX_POINTS, MAX_SIDE, Method, Target};

    fn header(width: usize, height: usize, component_count: usize) -> Header {
        Header { format: PictureFormat::Png, width, height, component_count, precision: 8 }
    }

    fn peak(header: &Header, parameters: &Parameters, format: Format) -> u64 {
        let plan = parameters.plan(header.shape()).unwrap();
        Footprint::new(header, &plan, parameters, format).peak()
    }

    /// The peak for three components and a megapixel, with parameters changed.
    fn changed(method: Method, change: impl FnOnce(&mut Parameters)) -> u64 {
        let mut parameters = method.parameters(Target::Percent(0.5));
        change(&mut parameters);
        peak(&header(1024, 1024, 3), &parameters, Format::Model)
    }

    #[test]
    fn more_of_anything_never_takes_less() {
        for method in [Method::Med, Method::Mgprfs, Method::Mgpr] {
            let of = |width, components, density, format| {
                let parameters = method.parameters(Target::Percent(density));
                peak(&header(width, 500, components), &parameters, format)
            };
            for format in [Format::Model, Format::Glb, Format::Png, Format::Pnm] {
                let least = of(500, 3, 2.0, format);
                assert!(of(501, 3, 2.0, format) > least, "{method}");
                assert!(of(500, 4, 2.0, format) >= least, "{method}");
                assert!(of(500, 3, 9.0, format) >= least, "{method}");
            }
        }
    }

    #[test]
    fn what_keeps_more_per_pixel_takes_more() {
        let with_policy = |policy| changed(Method::Med, |with| with.policy = policy);
        let plain = with_policy(Policy::PsdMaxD);
        let apart = with_policy(Policy::PseD);
        assert!(apart > plain);
        assert_eq!(with_policy(Policy::Psc), plain);
        let luma = changed(Method::Med, |with| with.guide = Guide::Luma);
        assert!(luma > plain);
    }

    #[test]
    fn points_that_are_not_diffused_need_no_density() {
        let of = |generator| {
            changed(Method::Med, |with| {
                with.generator = generator;
                with.policy = Policy::Psc;
            })
        };
        assert!(of(Generator::Uniform) < of(Generator::ErrorDiffusion));
        assert!(of(Generator::Uniform) <= of(Generator::Random));
        let few = changed(Method::Preview, |with| with.target = Target::Percent(10.0));
        assert!(changed(Method::Preview, |with| with.target = Target::Percent(20.0)) > few);
    }

    #[test]
    fn preview_of_large_picture_takes_what_med_takes() {
        let of = |method: Method, side| {
            peak(&header(side, side, 3), &method.parameters(Target::Percent(2.0)), Format::Model)
        };
        assert_ne!(of(Method::Preview, 1024), of(Method::Med, 1024));
        assert_eq!(of(Method::Preview, 1025), of(Method::Med, 1025));
    }

    #[test]
    fn below_a_bound_on_the_error_every_initial_point_may_stay() {
        let of = |target| {
            let mut parameters = Method::Mgprfs.parameters(target);
            parameters.initial_size = InitialSize::Percent(100.0);
            let header = header(512, 512, 3);
            let plan = parameters.plan(header.shape()).unwrap();
            Footprint::new(&header, &plan, &parameters, Format::Model).encoding()
        };
        assert!(of(Target::Psnr(40.0)) > 4 * of(Target::Percent(1.0)));
        assert_eq!(of(Target::Psnr(40.0)), of(Target::MeanError(5.0)));
    }

    #[test]
    fn pictures_of_many_bits_are_copied_only_where_moves_are_foreseen() {
        let deep = Header { precision: 16, ..header(1024, 1024, 3) };
        let more_than_of_8_bits = |method: Method| {
            let parameters = method.parameters(Target::Percent(1.0));
            let plan = parameters.plan(deep.shape()).unwrap();
            let of = |header| {
                let footprint = Footprint::new(header, &plan, &parameters, Format::Model);
                footprint.triangulating() as i64
            };
            of(&deep) - of(&header(1024, 1024, 3))
        };
        assert_eq!(more_than_of_8_bits(Method::Med), -(4 << 20));
        assert_eq!(more_than_of_8_bits(Method::Optimal), 4 << 20);
    }

    #[test]
    fn the_largest_picture_does_not_overflow() {
        let (width, height) = (MAX_SIDE, MAX_POINTS / MAX_SIDE);
        let parameters = Method::Mgpr.parameters(Target::Percent(100.0));
        let shape = Shape { width, height, component_count: 4, precision: 8 };
        let plan = parameters.plan(shape).unwrap();
        let header = header(width, height, 4);
        assert!(Footprint::new(&header, &plan, &parameters, Format::Model).peak() > 1 << 37);
    }
}
