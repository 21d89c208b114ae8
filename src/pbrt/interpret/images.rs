//! Image files that parameters name.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use crate::pbrt::error::{Place, Problem, Result};
use crate::pbrt::parameters::Parameters;
use crate::picture::{Raster, RasterSamples, Transfer};
use crate::scene::{ImageId, LightImage};

use super::Builder;

/// Images that were read, by file: each is read once however often it is named.
#[derive(Default)]
pub(super) struct Images {
    read: HashMap<PathBuf, Arc<Raster>>,
    of_lights: HashMap<PathBuf, ImageId>,
}

impl Builder {
    /// The image file that a parameter names, and its path; `None` if the parameter is not given, or empty.
    pub(super) fn image_file(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<(PathBuf, Arc<Raster>)>> {
        let Some(file) = parameters.string(name)?.filter(|file| !file.is_empty()) else {
            return Ok(None);
        };
        let path = self.resolve(file);
        if let Some(image) = self.images.read.get(&path) {
            return Ok(Some((path, image.clone())));
        }
        self.inputs.push(path.clone());
        let place = parameters.find(name).map_or(Place::Scene, |p| p.place(0));
        let image = Raster::read(&path).map_err(|error| {
            let problem = Problem::new(place, error.to_string())
                .label("expected an image: PNG, TGA, JPEG, OpenEXR, Radiance HDR or PFM");
            let far = self.main_directory.join(file);
            if path.exists() || far == path {
                return problem;
            }
            problem.note(Place::Nowhere, format!("nor is there a file {}", far.display()))
        })?;
        let image = Arc::new(image);
        self.images.read.insert(path.clone(), image.clone());
        Ok(Some((path, image)))
    }

    /// The same for the image of a light, whose colours must be finite.
    pub(super) fn light_image(
        &mut self,
        parameters: &Parameters,
        name: &'static str,
    ) -> Result<Option<(LightImage, Arc<Raster>)>> {
        let Some((path, image)) = self.image_file(parameters, name)? else { return Ok(None) };
        let place = parameters.find(name).map_or(Place::Scene, |p| p.place(0));
        if let Some([x, y]) = image.first_not_finite() {
            return Err(Problem::new(
                place,
                format!("an image with infinite pixels, or such as are no numbers: {}", path.display()),
            )
            .label(format!("the first is in column {x}, row {y}: not suitable as a light")));
        }
        // pbrt-v3 takes the numbers of a file as they are, but in textures.
        let transfer = if self.dialect.is_v3() { Transfer::Linear } else { Transfer::Srgb };
        let id = match self.images.of_lights.get(&path) {
            Some(&id) => id,
            None => {
                let id = self.scene.add_light_image(image.clone());
                self.images.of_lights.insert(path, id);
                id
            }
        };
        Ok(Some((LightImage { image: id, transfer }, image)))
    }

    /// A white image of one pixel, for lights that need one.
    pub(super) fn white_image(&mut self) -> (LightImage, Arc<Raster>) {
        let path = PathBuf::new();
        let white = || Raster::new(1, 1, 1, RasterSamples::Bytes(vec![255])).map(Arc::new);
        let known = self.images.of_lights.get(&path).copied();
        let id = match (known, white()) {
            (Some(id), _) => id,
            (None, Some(white)) => {
                let id = self.scene.add_light_image(white);
                self.images.of_lights.insert(path, id);
                id
            }
            (None, None) => unreachable!("one pixel of one channel"),
        };
        let raster = self.scene.light_images[id.0 as usize].clone();
        (LightImage { image: id, transfer: Transfer::Linear }, raster)
    }
}
