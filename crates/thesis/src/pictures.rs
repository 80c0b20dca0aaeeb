//! The pictures of a folder, each in colour where it has colour, and in gray.

use pixmesh_cli::{CliError, files};
use pixmesh_meshing::{Image, ImageError};
use std::path::{Path, PathBuf};

/// A picture as the tables use it.
pub struct Picture {
    /// The picture itself, when it has three components.
    colour: Option<Image>,
    /// The picture itself when it has one component, its gray version when it has three.
    gray: Image,
}

impl Picture {
    /// Reads a picture.
    ///
    /// # Errors
    /// In words, why the tables cannot have it.
    pub fn read(path: &Path) -> Result<Self, String> {
        // The caller names the file.
        let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
        let image =
            pixmesh_codec::decode(&bytes, &files::LIMITS).map_err(|error| error.to_string())?;
        match image.component_count() {
            1 => Ok(Self { colour: None, gray: image }),
            3 => {
                let gray = netpbm_gray(&image).map_err(|error| error.to_string())?;
                Ok(Self { colour: Some(image), gray })
            }
            count => Err(format!("it has {count} components, the tables are of 1 and 3")),
        }
    }

    /// The image of 1 or 3 components, if the picture has it.
    #[must_use]
    pub fn image(&self, components: usize) -> Option<&Image> {
        if components == 1 { Some(&self.gray) } else { self.colour.as_ref() }
    }

    /// A checksum of the samples, which tells a picture from one of the same name.
    #[must_use]
    pub fn digest(&self) -> u64 {
        let image = self.colour.as_ref().unwrap_or(&self.gray);
        let shape = [image.width(), image.height(), usize::from(image.precision())];
        let shape = shape.iter().flat_map(|&number| (number as u64).to_le_bytes());
        let samples = image.components().iter().flatten().flat_map(|sample| sample.to_le_bytes());
        fnv_1a(shape.chain(samples))
    }
}

/// The checksum of Glenn Fowler, Landon Curt Noll and Phong Vo.
fn fnv_1a(bytes: impl Iterator<Item = u8>) -> u64 {
    let step = |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.fold(0xcbf2_9ce4_8422_2325, step)
}

/// The gray version that the thesis used, netpbm's.
fn netpbm_gray(image: &Image) -> Result<Image, ImageError> {
    let weighted = |i: usize| {
        let [red, green, blue] = [0, 1, 2].map(|c| u32::from(image.components()[c][i]));
        ((77 * red + 150 * green + 29 * blue + 128) >> 8) as u16
    };
    let samples = (0..image.pixel_count()).map(weighted).collect();
    Image::from_bottom_up(image.width(), image.height(), image.precision(), vec![samples])
}

/// The files of a folder, by name; not those of folders in it.
///
/// # Errors
/// When the folder cannot be read.
pub fn files_of(folder: &Path) -> Result<Vec<PathBuf>, CliError> {
    let list = || {
        let entries = std::fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path()));
        entries.collect::<Result<Vec<PathBuf>, _>>()
    };
    let name = || folder.display().to_string();
    let mut paths = list().map_err(|source| CliError::File { name: name(), source })?;
    paths.retain(|path| path.is_file());
    paths.sort();
    Ok(paths)
}

/// What the tables call each file: its name without the extension, where that names one only.
#[must_use]
pub fn names(paths: &[PathBuf]) -> Vec<String> {
    let shared = |stem: &str| paths.iter().filter(|path| stem_of(path) == stem).count() > 1;
    let name = |path: &PathBuf| match stem_of(path) {
        stem if shared(&stem) => file_name(path),
        stem => stem,
    };
    paths.iter().map(name).collect()
}

/// A file's name without the extension, which the published figures know it by.
#[must_use]
pub fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// A file's name.
#[must_use]
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(colour: Vec<Vec<u16>>) -> Picture {
        let image = Image::from_bottom_up(2, 2, 8, colour).unwrap();
        Picture { gray: netpbm_gray(&image).unwrap(), colour: Some(image) }
    }

    #[test]
    fn gray_is_weighted_as_netpbm_does() {
        let gray = picture(vec![vec![255, 0, 0, 255], vec![0, 255, 0, 255], vec![0, 0, 255, 255]]);
        assert_eq!(gray.image(1).unwrap().components()[0], [77, 149, 29, 255]);
    }

    #[test]
    fn a_changed_sample_changes_the_digest() {
        let plain = vec![vec![1, 2, 3, 4]; 3];
        let mut changed = plain.clone();
        changed[2][3] = 5;
        assert_eq!(picture(plain.clone()).digest(), picture(plain.clone()).digest());
        assert_ne!(picture(plain).digest(), picture(changed).digest());
    }

    #[test]
    fn names_keep_the_extension_only_where_they_must() {
        let paths = ["d/a.png", "d/b.pgm", "d/b.ppm"].map(PathBuf::from);
        assert_eq!(names(&paths), ["a", "b.pgm", "b.ppm"]);
    }
}
