//! The state that `AttributeBegin` saves.

use std::rc::Rc;

use glam::DAffine3;

use crate::scene::{Emission, MaterialId};

use super::error::Span;
use super::parameters::Parameter;
use super::parser::Name;

/// Which ends of the shutter interval transforms apply to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ActiveTransform {
    All,
    Start,
    End,
}

/// Defaults that `Attribute` gave.
#[derive(Clone, Debug, Default)]
pub(crate) struct Defaults {
    pub shape: Vec<Rc<Parameter>>,
    pub light: Vec<Rc<Parameter>>,
    pub material: Vec<Rc<Parameter>>,
    pub texture: Vec<Rc<Parameter>>,
}

/// The emission that following shapes get.
#[derive(Clone, Debug)]
pub(crate) struct AreaLight {
    pub emission: Emission,
    pub span: Span,
}

/// The media on both sides of following shapes.
#[derive(Clone, Debug, Default)]
pub(crate) struct MediumInterface {
    /// One of them is not the vacuum: its place.
    pub named: Option<Span>,
    /// A path that crosses the surface changes the medium.
    pub is_transition: bool,
    /// The outside, in which the camera and lights are, is not the vacuum.
    pub outside: bool,
}

impl MediumInterface {
    pub(crate) fn new(inside: &Name, outside: &Name) -> MediumInterface {
        let named = [inside, outside].into_iter().find(|name| !name.text.is_empty());
        MediumInterface {
            named: named.map(|name| name.span),
            is_transition: inside.text != outside.text,
            outside: !outside.text.is_empty(),
        }
    }
}

/// Everything that `AttributeBegin` saves and `AttributeEnd` brings back.
#[derive(Clone, Debug)]
pub(crate) struct GraphicsState {
    /// Object to world (camera: world to camera), at shutter opening and at closing.
    pub ctm: [DAffine3; 2],
    pub active: ActiveTransform,
    pub material: MaterialId,
    pub medium: MediumInterface,
    pub area_light: Option<AreaLight>,
    pub reverse_orientation: bool,
    /// Shared, because they change rarely and states are saved often.
    pub defaults: Rc<Defaults>,
}

impl GraphicsState {
    pub(crate) fn new(material: MaterialId) -> GraphicsState {
        GraphicsState {
            ctm: [DAffine3::IDENTITY; 2],
            active: ActiveTransform::All,
            material,
            medium: MediumInterface::default(),
            area_light: None,
            reverse_orientation: false,
            defaults: Rc::default(),
        }
    }

    /// Changes the active ones of the two transforms.
    pub(crate) fn update(&mut self, change: impl Fn(DAffine3) -> DAffine3) {
        if self.active != ActiveTransform::End {
            self.ctm[0] = change(self.ctm[0]);
        }
        if self.active != ActiveTransform::Start {
            self.ctm[1] = change(self.ctm[1]);
        }
    }
}
