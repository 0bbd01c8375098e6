//! JSON schema of the scene file, by which editors complete and check scenes.

use super::keys::{TableKeys, ValueKind};
use super::read::SCENE;
use super::typed::{OVER_TIME, Quantity};
use crate::field::Names;
use serde_json::{Map, Value, json};

/// Returns the JSON schema (draft 7) of scene files.
///
/// It is made from the keys that the reader of scenes declares, with their types, ranges and words.
/// The reader checks more: formulas, names, and what keys say together.
pub fn schema() -> Value {
    let mut schema = Map::new();
    schema.insert("$schema".into(), json!("http://json-schema.org/draft-07/schema#"));
    schema.insert("title".into(), json!("Scene of rebond, in SI units"));
    schema.extend(of_table(&SCENE));
    Value::Object(schema)
}

fn of_table(table: &TableKeys) -> Map<String, Value> {
    let property = |key: &'static super::keys::TableKey| {
        let mut schema = Map::new();
        schema.insert("description".into(), key.meaning.into());
        schema.extend(of_value(&key.value));
        (key.name.to_owned(), Value::Object(schema))
    };
    let mut schema = object([("type", json!("object"))]);
    schema.insert("properties".into(), Value::Object(table.keys().map(property).collect()));
    schema.insert("additionalProperties".into(), false.into());
    if !table.needed.is_empty() {
        schema.insert("required".into(), json!(table.needed));
    }
    if !table.one_of.is_empty() {
        let choices: Vec<Value> = table.one_of.iter().map(|keys| json!({ "required": keys })).collect();
        schema.insert("oneOf".into(), choices.into());
    }
    schema
}

fn of_value(kind: &ValueKind) -> Map<String, Value> {
    match kind {
        ValueKind::Text => object([("type", json!("string"))]),
        ValueKind::Condition => object([("type", json!("string"))]),
        ValueKind::Truth => object([("type", json!("boolean"))]),
        ValueKind::Number(quantity) => number(json!("number"), quantity),
        ValueKind::Field(quantity, names) => {
            let plain = number(json!(["number", "string"]), quantity);
            if names.meets(Names::T) {
                object([("anyOf", json!([plain, of_table(&OVER_TIME)]))])
            } else {
                plain
            }
        }
        ValueKind::Count(least) => object([("type", json!("integer")), ("minimum", json!(least))]),
        ValueKind::Word(words) => object([("enum", json!(words()))]),
        ValueKind::Array(item) => array(of_value(item)),
        ValueKind::List(item) => {
            let mut schema = array(of_value(item));
            schema.extend(object([("minItems", json!(1)), ("uniqueItems", json!(true))]));
            schema
        }
        ValueKind::Pair(item) => {
            let mut schema = array(of_value(item));
            schema.extend(object([("minItems", json!(2)), ("maxItems", json!(2))]));
            schema
        }
        ValueKind::Table(table) => of_table(table),
        ValueKind::Tables(table) => array(of_table(table)),
        ValueKind::Names(quantity) => {
            let names = number(json!("number"), quantity);
            object([("type", json!("object")), ("additionalProperties", Value::Object(names))])
        }
    }
}

fn number(of_type: Value, quantity: &Quantity) -> Map<String, Value> {
    let mut schema = object([("type", of_type)]);
    schema
        .extend(quantity.range.keywords.iter().map(|(keyword, limit)| ((*keyword).to_owned(), json!(limit))));
    schema
}

fn array(items: Map<String, Value>) -> Map<String, Value> {
    object([("type", json!("array")), ("items", Value::Object(items))])
}

fn object<const N: usize>(entries: [(&str, Value); N]) -> Map<String, Value> {
    entries.into_iter().map(|(keyword, value)| (keyword.to_owned(), value)).collect()
}
