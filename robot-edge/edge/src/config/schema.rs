//! Which keys exist and what each may hold, asked of the configuration's own types.
//!
//! Serde passes a deserializer the fields of every struct and the variants of every enum. A [`SchemaProbe`] is a
//! deserializer that holds no data: it writes down what it is asked for. So a new field is a known key at
//! once, and there is no list to keep synchronized.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::value::Error;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IntoDeserializer, MapAccess, Visitor};
use serde::forward_to_deserialize_any;

use drivers::config::DeviceConfig;

use super::sensors::{
    BumperConfig, GpsConfig, ImuConfig, LidarConfig, RangeSensorConfig, SensorConfig,
    UltrasonicConfig, WheelEncodersConfig,
};
use super::{Config, sensors};

/// The kind of each sensor, by name, as far as it is named.
pub(super) type SensorKinds<'a> = BTreeMap<&'a str, &'a str>;

/// The schema of a key.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Schema {
    Table(BTreeMap<&'static str, Schema>),
    /// A table of sensors, which the user names; the keys of each depend on its `kind`.
    Sensors(SensorSchemas),
    /// A table of devices, which the user names.
    Devices(Box<Schema>),
    Value(Expected),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct SensorSchemas {
    by_kind: BTreeMap<&'static str, Schema>,
    /// Every key of every kind: for a sensor without a known kind.
    any: Box<Schema>,
}

impl SensorSchemas {
    fn of_config() -> Result<Self, Error> {
        // An internally tagged enum does not report its fields: its variants are probed one by one.
        let mut by_kind = BTreeMap::from([
            ("laser_scan", Schema::of::<RangeSensorConfig>()?),
            ("lidar", Schema::of::<LidarConfig>()?),
            ("sonar", Schema::of::<RangeSensorConfig>()?),
            ("wheel_encoders", Schema::of::<WheelEncodersConfig>()?),
            ("imu", Schema::of::<ImuConfig>()?),
            ("gps", Schema::of::<GpsConfig>()?),
            ("ultrasonic", Schema::of::<UltrasonicConfig>()?),
            ("bumper", Schema::of::<BumperConfig>()?),
        ]);
        let mut any = BTreeMap::new();
        for schema in by_kind.values_mut() {
            if let Schema::Table(keys) = schema {
                keys.insert("kind", Schema::Value(Expected::OneOf(SensorConfig::KINDS)));
                any.extend(keys.clone());
            }
        }
        Ok(Self {
            by_kind,
            any: Box::new(Schema::Table(any)),
        })
    }

    pub(super) fn of_kind(&self, kind: Option<&str>) -> &Schema {
        kind.and_then(|kind| self.by_kind.get(kind))
            .unwrap_or(&self.any)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    Bool,
    /// A whole number from 0 to this.
    Integer(u64),
    Number,
    Text,
    OneOf(&'static [&'static str]),
    Table,
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool => f.write_str("true or false"),
            Self::Integer(_) => f.write_str("a whole number, not negative"),
            Self::Number => f.write_str("a number"),
            Self::Text => f.write_str("text in quotes"),
            Self::OneOf(words) => {
                f.write_str(if words.len() == 1 { "" } else { "one of " })?;
                for (i, word) in words.iter().enumerate() {
                    write!(f, "{}\"{word}\"", if i == 0 { "" } else { ", " })?;
                }
                Ok(())
            }
            Self::Table => f.write_str("a table of settings"),
        }
    }
}

impl Schema {
    pub(super) fn of_config() -> Result<Self, Error> {
        let mut config = Self::of::<Config>()?;
        if let Self::Table(keys) = &mut config {
            keys.insert("sensors", Self::Sensors(SensorSchemas::of_config()?));
            keys.insert(
                "devices",
                Self::Devices(Box::new(Self::of::<DeviceConfig>()?)),
            );
        }
        Ok(config)
    }

    fn of<'de, T: Deserialize<'de>>() -> Result<Self, Error> {
        let mut schema = Self::Value(Expected::Bool);
        T::deserialize(SchemaProbe(&mut schema))?;
        Ok(schema)
    }

    /// The schema of `key` in this table; of sensors, given the kind of each.
    pub(super) fn get(&self, key: &str, kinds: &SensorKinds<'_>) -> Option<&Self> {
        match self {
            Self::Table(keys) => keys.get(key),
            Self::Sensors(shapes) => Some(shapes.of_kind(kinds.get(key).copied())),
            Self::Devices(schema) => Some(schema),
            Self::Value(_) => None,
        }
    }

    pub(super) const fn expected(&self) -> Expected {
        match self {
            Self::Table(_) | Self::Sensors(_) | Self::Devices(_) => Expected::Table,
            Self::Value(expected) => *expected,
        }
    }

    /// Paths of all keys, tables included, with the sensor or device `name`, a sensor of this kind, for all.
    pub(super) fn paths(&self, name: &str, kind: Option<&str>) -> Vec<(String, Expected)> {
        let mut paths = Vec::new();
        self.collect_paths("", (name, kind), &mut paths);
        paths
    }

    fn collect_paths(
        &self,
        prefix: &str,
        sensor: (&str, Option<&str>),
        paths: &mut Vec<(String, Expected)>,
    ) {
        let mut child = |key: &str, schema: &Self| {
            let path = super::config_layer::join(prefix, key);
            paths.push((path.clone(), schema.expected()));
            schema.collect_paths(&path, sensor, paths);
        };
        match self {
            Self::Table(keys) => keys.iter().for_each(|(key, schema)| child(key, schema)),
            Self::Sensors(shapes) => child(sensor.0, shapes.of_kind(sensor.1)),
            Self::Devices(schema) => child(sensor.0, schema),
            Self::Value(_) => {}
        }
    }

    /// Name that stands in for sensors a path does not name.
    pub(super) const SENSOR: &str = sensors::MAIN_LASER;
}

/// A deserializer without data.
struct SchemaProbe<'a>(&'a mut Schema);

impl SchemaProbe<'_> {
    fn whole_number(self, max: u64) {
        *self.0 = Schema::Value(Expected::Integer(max));
    }
}

impl<'de> Deserializer<'de> for SchemaProbe<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, _visitor: V) -> Result<V::Value, Error> {
        Err(Error::custom(
            "a configuration holds tables, numbers, text, words and truth values",
        ))
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        *self.0 = Schema::Value(Expected::Bool);
        visitor.visit_bool(false)
    }

    fn deserialize_u32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.whole_number(u32::MAX.into());
        visitor.visit_u32(0)
    }

    fn deserialize_u64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        // TOML's integers are signed.
        self.whole_number(i64::MAX.unsigned_abs());
        visitor.visit_u64(0)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        *self.0 = Schema::Value(Expected::Number);
        visitor.visit_f64(0.0)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        *self.0 = Schema::Value(Expected::Text);
        visitor.visit_str("")
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.deserialize_str(visitor)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        *self.0 = Schema::Table(BTreeMap::new());
        visitor.visit_map(Fields {
            table: self.0,
            rest: fields.iter(),
            field: "",
        })
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        *self.0 = Schema::Table(BTreeMap::new());
        visitor.visit_map(Fields {
            table: self.0,
            rest: [].iter(),
            field: "",
        })
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        *self.0 = Schema::Value(Expected::OneOf(variants));
        let first = variants.first().ok_or_else(|| Error::custom(name))?;
        visitor.visit_enum((*first).into_deserializer())
    }

    forward_to_deserialize_any! {
        i8 i16 i32 i64 u8 u16 f32 char bytes byte_buf unit unit_struct newtype_struct seq tuple
        tuple_struct identifier ignored_any
    }
}

struct Fields<'a> {
    table: &'a mut Schema,
    rest: std::slice::Iter<'static, &'static str>,
    field: &'static str,
}

impl<'de> MapAccess<'de> for Fields<'_> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Error> {
        let Some(field) = self.rest.next() else {
            return Ok(None);
        };
        self.field = field;
        seed.deserialize((*field).into_deserializer()).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Error> {
        let mut schema = Schema::Value(Expected::Bool);
        let value = seed.deserialize(SchemaProbe(&mut schema))?;
        if let Schema::Table(keys) = &mut *self.table {
            keys.insert(self.field, schema);
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_scripts_rely_on_is_known() {
        let paths = Schema::of_config()
            .unwrap()
            .paths("laser", Some("laser_scan"));
        let expected = |wanted: &str| {
            let found = paths.iter().find(|(path, _)| path == wanted);
            found.unwrap_or_else(|| panic!("{wanted}")).1
        };
        for key in [
            "vehicle.length_m",
            "vehicle.width_m",
            "vehicle.height_m",
            "vehicle.max_speed_mps",
            "vehicle.max_turn_rate_radps",
            "sensors.laser.range_min_m",
            "sensors.laser.range_max_m",
            "sensors.laser.time_offset_s",
            "mapping.occupancy.cell_m",
            "mapping.occupancy.p_free",
            "mapping.occupancy.p_occupied",
        ] {
            assert_eq!(expected(key), Expected::Number, "{key}");
        }
        assert_eq!(expected("sensors.laser.mount"), Expected::Table);
        assert_eq!(
            expected("sensors.laser.kind"),
            Expected::OneOf(SensorConfig::KINDS)
        );
        assert_eq!(
            expected("mapping.occupancy.miss"),
            Expected::OneOf(&["unknown", "free"])
        );
        assert_eq!(
            expected("streaming.budget_kbps"),
            Expected::Integer(u32::MAX.into())
        );
        assert_eq!(expected("localization.fixed_frame"), Expected::Text);
    }

    #[test]
    fn every_kind_of_sensor_can_be_named_and_has_the_keys_it_is_asked_for() {
        let schema = Schema::of_config().unwrap();
        let only_of = |kind| {
            let keys = schema.paths("s", Some(kind));
            let has = |key: &str| {
                keys.iter()
                    .any(|(path, _)| *path == format!("sensors.s.{key}"))
            };
            ["tilt.joint", "wheel_radius_m", "mount.yaw_deg"].map(has)
        };
        assert_eq!(only_of("laser_scan"), [true, false, true]);
        assert_eq!(only_of("wheel_encoders"), [false, true, false]);
        assert_eq!(only_of("sonar"), [true, false, true]);
        assert_eq!(only_of("imu"), [false, false, true]);
        assert_eq!(only_of("gps"), [false, false, true]);
        assert_eq!(only_of("ultrasonic"), [false, false, true]);
        assert_eq!(only_of("bumper"), [false, false, true]);
        for kind in SensorConfig::KINDS {
            let sensor: SensorConfig = toml::from_str(&format!("kind = \"{kind}\"")).unwrap();
            assert_eq!(sensor.kind(), *kind);
        }
    }
}
