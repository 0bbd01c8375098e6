//! Tables `[plate]` and `[[part]]`: sides, thickness and material.

use super::document::{Document, join};
use super::entry::{Entry, Keys, Kind, SceneText, Table, table, via};
use super::given::{FieldInput, Region};
use super::kinds::{condition, number, positive, within};
use super::place::{CellKeys, SiteKeys, group, region, site_keys};
use crate::error::Result;
use crate::field::{Condition, Names};
use crate::mesh::Point;
use crate::plate::{Orthotropy, Plate};

table! {
    /// Plate: a rectangle on `[0, length] x [0, width]` unless a file gives its shape.
    #[derive(Debug, Clone, PartialEq)]
    pub struct PlateSpec {
        /// Side along x, from the origin; greater than 0. Not allowed with `mesh.file`, and then 0.
        length: f64 = side("a length", "m, along x");
        /// Side along y, from the origin; greater than 0. Not allowed with `mesh.file`, and then 0.
        width: f64 = side("a width", "m, along y");
        /// Thickness and material.
        plate: Plate,
        /// Thickness in m if it varies; `plate` then has its value at the origin.
        thickness: Option<FieldInput> = material(false);
    }
}

table! {
    /// Part of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Part {
        /// Cells of a group, or those whose centre satisfies a condition.
        region: Region = via(cells, part_keys);
        /// Thickness and material of the part.
        plate: Plate,
        /// Thickness in m if it varies.
        thickness: Option<FieldInput> = material(true);
    }
}

/// Side of a rectangle, with its comment; 0 where a file gives the shape.
fn side(what: &str, comment: &str) -> Entry<f64> {
    let read = |kind: &Kind<f64>, doc: &Document, key: &str| {
        if doc.get("mesh.file").is_none() {
            return doc.required(key, kind);
        }
        doc.forbid(key, "contradicts mesh.file, which gives the plate its shape").map(|()| 0.0)
    };
    positive(what, "m").says(comment).entry("", read, |side| (*side > 0.0).then_some(side))
}

table! {
    /// Thickness and material as a scene gives them.
    struct Material {
        /// Field of x, y; greater than 0 everywhere.
        thickness: FieldInput = inherited(positive("a thickness", "m").field(Names::XY));
        /// Greater than 0; along the grain, if the plate has one.
        youngs_modulus: f64 = inherited(positive("Young's modulus", "Pa"));
        /// Greater than -1 and less than 0.5; for an orthotropic plate nu_12, with nu_12^2 < E_1 /
        /// E_2.
        poissons_ratio: f64 = inherited(
            within("Poisson's ratio", "", &[("exclusiveMinimum", -1.0), ("exclusiveMaximum", 0.5)]),
        );
        /// Greater than 0.
        density: f64 = inherited(positive("a density", "kg/m3"));
        /// E_2; this key makes the plate orthotropic.
        youngs_modulus_across: Option<f64> = inherited(positive("Young's modulus", "Pa").optional());
        /// G_12; needed if the plate is orthotropic.
        shear_modulus: Option<f64> = inherited(shear_modulus().optional());
        /// Angle of the grain from x, counter-clockwise, by default 0; only for an orthotropic
        /// plate.
        grain: Option<f64> = inherited(number("an angle", "degrees").says("degrees from x").optional());
        /// Thermal expansion, the same along and across a grain, by default 0; needed with
        /// [`in_plane.temperature`](#in_plane).
        expansion: Option<f64> = inherited(number("a thermal expansion", "1/K").optional());
    }
}

fn shear_modulus() -> Kind<f64> {
    positive("a shear modulus", "Pa")
}

/// Key that a part may omit; the value of `[plate]` then counts.
fn inherited<V: 'static>(entry: impl Into<Entry<V>>) -> Entry<V> {
    let Entry { describe, read, write } = entry.into();
    let read = move |doc: &Document, table: &str, name: &str| {
        read(doc, if doc.get(&join(table, name)).is_some() { table } else { "plate" }, name)
    };
    Entry { describe, read: Box::new(read), write }
}

/// Keys of thickness and material.
fn material(is_part: bool) -> Entry<(Plate, Option<FieldInput>)> {
    let describe = move |_, _: &str, keys: &mut Keys| {
        keys.include(Material::keys());
        keys.keys.iter_mut().for_each(|key| key.is_needed &= !is_part);
    };
    let write = move |_: &str, material: &(Plate, Option<FieldInput>), lines: &mut SceneText| {
        material_keys(material).write(lines);
        // A part inherits the plate's formula; written here, it would become the part's own.
        if is_part && material.1.as_ref().is_some_and(|thickness| thickness.key == "plate.thickness") {
            lines.omit("thickness");
        }
    };
    Entry { describe: Box::new(describe), write: Box::new(write), ..via(checked, material_keys) }
}

/// Returns thickness and material, and the field of a thickness that varies.
fn checked(material: Material, doc: &Document, table: &str) -> Result<(Plate, Option<FieldInput>)> {
    let Material { youngs_modulus, poissons_ratio, density, shear_modulus, grain, .. } = material;
    let key = |name: &str| join(table, name);
    let orthotropy = match material.youngs_modulus_across {
        None => {
            for name in ["shear_modulus", "grain"] {
                let wrong = "has no use without youngs_modulus_across, for an isotropic plate has no grain";
                doc.forbid(&key(name), wrong)?;
            }
            None
        }
        Some(across) => {
            let missing = || doc.missing(&key("shear_modulus"), self::shear_modulus().expected);
            let shear_modulus = shear_modulus.ok_or_else(missing)?;
            Some(Orthotropy { across, shear_modulus, grain: grain.unwrap_or(0.0) })
        }
    };
    if let Some(Orthotropy { across, .. }) = orthotropy
        && poissons_ratio.powi(2) * across >= youngs_modulus
    {
        let wrong = "is out of range for these moduli; expected nu12^2 < E1 / E2";
        return Err(doc.fault(&key("poissons_ratio"), format!("{poissons_ratio:?} {wrong}")));
    }
    let (thickness, field) = match material.thickness.number() {
        Some(thickness) => (thickness, None),
        // The origin need not lie on the plate, so that an error there does not matter.
        None => (material.thickness.at(Point::origin(), 0.0).unwrap_or(0.0), Some(material.thickness)),
    };
    let expansion = material.expansion.unwrap_or(0.0);
    Ok((Plate { thickness, youngs_modulus, poissons_ratio, density, orthotropy, expansion }, field))
}

fn material_keys((plate, thickness): &(Plate, Option<FieldInput>)) -> Material {
    let Plate { youngs_modulus, poissons_ratio, density, orthotropy, expansion, .. } = *plate;
    Material {
        thickness: thickness.clone().unwrap_or_else(|| FieldInput::new("", plate.thickness)),
        youngs_modulus,
        poissons_ratio,
        density,
        youngs_modulus_across: orthotropy.map(|grained| grained.across),
        shear_modulus: orthotropy.map(|grained| grained.shear_modulus),
        grain: orthotropy.map(|grained| grained.grain),
        expansion: (expansion != 0.0).then_some(expansion),
    }
}

table! {
    /// Keys of the cells of a part.
    struct PartKeys {
        /// Condition on x, y; the part consists of the cells whose centre satisfies it.
        part as "where": Option<Condition> = condition().optional();
        /// Physical surface of `mesh.file` whose cells form the part.
        group: Option<String> = group().optional();
    } one_of {where} {group}
}

/// Returns the cells of a part, which it must name.
fn cells(keys: PartKeys, doc: &Document, table: &str) -> Result<Region> {
    let cells = CellKeys { part: keys.part, group: keys.group };
    let keys = SiteKeys { cells, ..SiteKeys::default() };
    match region(keys, doc, table, PartKeys::keys().names())? {
        Region::All => Err(doc.missing(table, "expected where = \"...\" or group = \"...\"")),
        region => Ok(region),
    }
}

fn part_keys(region: &Region) -> PartKeys {
    let CellKeys { part, group } = site_keys(region).cells;
    PartKeys { part, group }
}
