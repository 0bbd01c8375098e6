//! Tables `[plate]`, `[[part]]` and `[damping]`: sides, thickness, material and losses.

use super::quantities::{
    DENSITY, GRAIN, LENGTH, MASS_DAMPING, POISSONS_RATIO, RATIO, SHEAR_MODULUS, STIFFNESS_DAMPING, THICKNESS,
    WIDTH, YOUNGS_MODULUS,
};
use super::region;
use crate::error::Result;
use crate::field::Names;
use crate::mesh::Point;
use crate::plate::Orthotropy;
use crate::scene::document::Document;
use crate::scene::keys::{TableKey, TableKeys, ValueKind, key};
use crate::scene::typed::Quantity;
use crate::scene::{Damping, FieldInput, Part, Plate, PlateSpec, Region};

/// Keys of thickness and material.
const MATERIAL: &[TableKey] = &[
    key("thickness", ValueKind::Field(&THICKNESS, Names::XY), "m, a number or a formula of x and y"),
    key("youngs_modulus", ValueKind::Number(&YOUNGS_MODULUS), "Pa; along the grain, if there is one"),
    key(
        "poissons_ratio",
        ValueKind::Number(&POISSONS_RATIO),
        "Poisson's ratio; nu_12 of an orthotropic plate",
    ),
    key("density", ValueKind::Number(&DENSITY), "kg/m3"),
    key(
        "youngs_modulus_across",
        ValueKind::Number(&YOUNGS_MODULUS),
        "Pa, E_2; it makes the plate orthotropic",
    ),
    key("shear_modulus", ValueKind::Number(&SHEAR_MODULUS), "Pa, G_12; an orthotropic plate needs it"),
    key("grain", ValueKind::Number(&GRAIN), "degrees from x, counter-clockwise; default 0"),
];

pub(super) static PLATE: TableKeys = TableKeys {
    groups: &[
        &[
            key("length", ValueKind::Number(&LENGTH), "m, along x; not with mesh.file"),
            key("width", ValueKind::Number(&WIDTH), "m, along y; not with mesh.file"),
        ],
        MATERIAL,
    ],
    needed: &["thickness", "youngs_modulus", "poissons_ratio", "density"],
    one_of: &[],
};

pub(super) static PART: TableKeys = TableKeys {
    groups: &[
        &[
            key(
                "where",
                ValueKind::Condition,
                "condition on x, y; the part has the cells whose centre satisfies it",
            ),
            key("group", ValueKind::Text, "physical surface of mesh.file"),
        ],
        MATERIAL,
    ],
    needed: &[],
    one_of: &[&["where"], &["group"]],
};

pub(super) static DAMPING: TableKeys = TableKeys::optional(&[&[
    key("mass", ValueKind::Number(&MASS_DAMPING), "1/s, Rayleigh's alpha; default 0"),
    key("stiffness", ValueKind::Number(&STIFFNESS_DAMPING), "s, Rayleigh's beta; default 0"),
    key(
        "modal",
        ValueKind::Array(&ValueKind::Number(&RATIO)),
        "damping ratios of the lowest modes, in ascending order",
    ),
]]);

pub(super) fn read(doc: &Document, has_file: bool) -> Result<PlateSpec> {
    doc.allow("plate", &PLATE)?;
    let side = |key: &str, quantity| {
        if has_file {
            doc.forbid(key, "contradicts mesh.file, which gives the plate its shape")?;
            return Ok(0.0);
        }
        doc.number(key, quantity)
    };
    let (length, width) = (side("plate.length", &LENGTH)?, side("plate.width", &WIDTH)?);
    let (plate, thickness) = material(doc, "plate", None)?;
    Ok(PlateSpec { length, width, plate, thickness })
}

/// Reads thickness and material of a table; missing keys take their values from `base`.
fn material(doc: &Document, table: &str, base: Option<&PlateSpec>) -> Result<(Plate, Option<FieldInput>)> {
    let number = |name: &str, quantity: &Quantity, of: fn(&Plate) -> f64| {
        let key = format!("{table}.{name}");
        match base {
            None => doc.number(&key, quantity),
            Some(base) => Ok(doc.optional_number(&key, quantity)?.unwrap_or(of(&base.plate))),
        }
    };
    let key = format!("{table}.thickness");
    let given = doc.given(&key, &THICKNESS, Names::XY)?.or(base.and_then(|base| base.thickness.clone()));
    let (thickness, field) = match given {
        Some(given) => match given.number() {
            Some(thickness) => (thickness, None),
            // The origin need not lie on the plate, so that an error there does not matter.
            None => (given.at(Point::origin(), 0.0).unwrap_or(0.0), Some(given)),
        },
        None => (number("thickness", &THICKNESS, |plate| plate.thickness)?, None),
    };
    let youngs_modulus = number("youngs_modulus", &YOUNGS_MODULUS, |plate| plate.youngs_modulus)?;
    let poissons_ratio = number("poissons_ratio", &POISSONS_RATIO, |plate| plate.poissons_ratio)?;
    let density = number("density", &DENSITY, |plate| plate.density)?;
    let orthotropy = orthotropy(doc, table, base.and_then(|base| base.plate.orthotropy))?;
    if let Some(Orthotropy { across, .. }) = orthotropy
        && poissons_ratio.powi(2) * across >= youngs_modulus
    {
        let wrong = format!("{poissons_ratio:?} is out of range for these moduli; expected nu12^2 < E1 / E2");
        return Err(doc.fault(&format!("{table}.poissons_ratio"), wrong));
    }
    Ok((Plate { thickness, youngs_modulus, poissons_ratio, density, orthotropy }, field))
}

/// Reads the second set of moduli, for an orthotropic plate.
fn orthotropy(doc: &Document, table: &str, base: Option<Orthotropy>) -> Result<Option<Orthotropy>> {
    let key = |name: &str| format!("{table}.{name}");
    let across = doc.optional_number(&key("youngs_modulus_across"), &YOUNGS_MODULUS)?;
    let Some(across) = across.or(base.map(|base| base.across)) else {
        for name in ["shear_modulus", "grain"] {
            let wrong = "has no use without youngs_modulus_across, for an isotropic plate has no grain";
            doc.forbid(&key(name), wrong)?;
        }
        return Ok(None);
    };
    let shear_modulus = match base {
        Some(base) => {
            doc.optional_number(&key("shear_modulus"), &SHEAR_MODULUS)?.unwrap_or(base.shear_modulus)
        }
        None => doc.number(&key("shear_modulus"), &SHEAR_MODULUS)?,
    };
    let grain = doc.optional_number(&key("grain"), &GRAIN)?.or(base.map(|base| base.grain)).unwrap_or(0.0);
    Ok(Some(Orthotropy { across, shear_modulus, grain }))
}

pub(super) fn read_parts(doc: &Document, plate: &PlateSpec) -> Result<Vec<Part>> {
    let part = |index: usize| {
        let table = format!("part.{index}");
        doc.allow(&table, &PART)?;
        let region = region::read(doc, &table, &["where", "group"])?;
        if region == Region::All {
            return Err(doc.missing(&table, "expected where = \"...\" or group = \"...\""));
        }
        let (plate, thickness) = material(doc, &table, Some(plate))?;
        Ok(Part { region, plate, thickness })
    };
    let count =
        doc.entries("part", "expected tables [[part]] with where or group, and what differs there")?;
    (0..count).map(part).collect()
}

pub(super) fn read_damping(doc: &Document) -> Result<Option<Damping>> {
    doc.allow("damping", &DAMPING)?;
    if doc.get("damping").is_none() {
        return Ok(None);
    }
    let ratio = |index: usize| doc.number(&format!("damping.modal.{index}"), &RATIO);
    let count = doc.entries("damping.modal", "expected an array of the damping ratios of the first modes")?;
    Ok(Some(Damping {
        mass: doc.optional_number("damping.mass", &MASS_DAMPING)?.unwrap_or(0.0),
        stiffness: doc.optional_number("damping.stiffness", &STIFFNESS_DAMPING)?.unwrap_or(0.0),
        modal: (0..count).map(ratio).collect::<Result<_>>()?,
    }))
}
