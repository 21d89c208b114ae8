//! Objects and their instances. Instances are flattened: each is a copy of the object's shapes in world space.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use glam::DAffine3;

use crate::pbrt::error::{Place, Problem, Result, Span};
use crate::pbrt::lexer::shorten;
use crate::pbrt::parser::Name;

use super::shapes::PlacedShape;
use super::{Block, Builder, unknown};

/// Objects by name, and the one that is being defined.
#[derive(Default)]
pub(super) struct Objects {
    defined: HashMap<String, Rc<Object>>,
    open: Option<OpenObject>,
    /// Instances of objects that are not defined so far: object, transform, place.
    waiting: Vec<(Name, DAffine3, Span)>,
}

struct OpenObject {
    name: String,
    span: Span,
    object: Object,
}

#[derive(Default)]
struct Object {
    shapes: Vec<PlacedShape>,
    /// What its shapes lack: matters once there is an instance.
    lacks: RefCell<Vec<Problem>>,
}

impl Objects {
    /// The shapes of the object that is being defined.
    pub(super) fn open_shapes(&mut self) -> Option<&mut Vec<PlacedShape>> {
        self.open.as_mut().map(|open| &mut open.object.shapes)
    }

    /// What the object lacks that is being defined.
    pub(super) fn open_lacks(&mut self) -> Option<&mut Vec<Problem>> {
        self.open.as_mut().map(|open| open.object.lacks.get_mut())
    }

    pub(super) fn is_open(&self) -> bool {
        self.open.is_some()
    }
}

impl Builder {
    pub(super) fn begin_object(&mut self, name: Name, span: Span) -> Result<()> {
        if let Some(open) = &self.objects.open {
            let outer = open.span;
            self.mistake(
                Problem::at(span, "ObjectBegin inside an object")
                    .label("objects cannot be nested")
                    .note(Place::Span(outer), "the outer object begins here"),
            )?;
            // pbrt-v3: what follows belongs to the new one.
            self.end_object();
        }
        if self.objects.defined.contains_key(&name.text) {
            let text = format!("object \"{}\" is defined twice", shorten(&name.text));
            self.mistake(Problem::at(name.span, text).label("expected a new name"))?;
        }
        self.push(Block::Object, span)?;
        self.objects.open = Some(OpenObject { name: name.text, span, object: Object::default() });
        Ok(())
    }

    pub(super) fn end_object(&mut self) {
        if let Some(open) = self.objects.open.take() {
            self.objects.defined.insert(open.name, Rc::new(open.object));
        }
    }

    pub(super) fn instance(&mut self, name: &Name, span: Span) -> Result<()> {
        if let Some(open) = &self.objects.open {
            let outer = open.span;
            return self.mistake(
                Problem::at(span, "ObjectInstance inside an object")
                    .label("instances of instances are not part of the format")
                    .note(Place::Span(outer), "the object begins here"),
            );
        }
        let world_from_instance = self.static_ctm(span)?;
        // v4 places instances when everything is read.
        let known = self.objects.defined.contains_key(&name.text);
        if !known && !self.dialect.is_v3() {
            self.objects.waiting.push((name.clone(), world_from_instance, span));
            return Ok(());
        }
        self.place(name, world_from_instance, span)
    }

    /// Places the instances that stood before their objects.
    pub(super) fn finish_instances(&mut self) -> Result<()> {
        for (name, world_from_instance, span) in std::mem::take(&mut self.objects.waiting) {
            self.place(&name, world_from_instance, span)?;
        }
        Ok(())
    }

    fn place(&mut self, name: &Name, world_from_instance: DAffine3, span: Span) -> Result<()> {
        let Some(object) = self.objects.defined.get(&name.text).cloned() else {
            return self.mistake(unknown("object", name, self.objects.defined.keys()));
        };
        for problem in object.lacks.take() {
            self.lack(problem);
        }
        for shape in &object.shapes {
            self.emit(shape, Some(world_from_instance), span)?;
        }
        Ok(())
    }
}
