//! What a column of a recording is, and the two tables from which messages and lists of their columns are made.
//!
//! A column is one row of `tables!` (columns of many values) or `record!` (a field of one value) in `frame.rs`: its number in the
//! schema, name, type, unit, when it holds, what kind of number it is, and what it means. The struct, its protobuf encoding and
//! [`Column`] come from that row. All else is a loop over columns: bytes of frames, checks of a reader, exported tables, the view
//! for Rerun, merging, comparing, and the schema (`tests/schema.rs`). The macros exist because prost wants struct fields.

/// A column, or a field of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Number in the schema.
    pub tag: u32,
    /// With its unit, e.g. `x_m`.
    pub name: &'static str,
    /// With its table, e.g. `links.x_m`: the name in [`super::frame::Header::channels`].
    pub channel: &'static str,
    /// How it is stored.
    pub stored: Stored,
    pub unit: &'static str,
    pub holds: Holds,
    pub kind: ColumnKind,
    /// One sentence.
    pub meaning: &'static str,
}

impl Column {
    /// The name in words, without unit: `lost_pin_damping_j` is `lost pin damping`.
    pub fn words(&self) -> String {
        self.name.trim_end_matches("_j").replace('_', " ")
    }
}

/// How a column of messages is stored. In memory all floats are f64, with the bits that their column stores
/// ([`super::stored_floats`]).
#[allow(non_camel_case_types)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    /// All 64 bits.
    double,
    /// A float and two bytes of what it leaves: 12 digits.
    double48,
    /// A float and one byte of what it leaves: 10 digits.
    double40,
    /// 7 digits.
    float,
    /// Not at all: computed from other columns when a frame is taken, and again when it is read ([`super::frame::Frame::derive`]).
    derived,
    uint32,
    uint64,
    bool,
    string,
}

impl Stored {
    /// Its type in the schema.
    pub fn schema_type(self) -> &'static str {
        match self {
            Stored::double => "double",
            Stored::double48 | Stored::double40 | Stored::float => "float",
            Stored::derived => "",
            Stored::uint32 => "uint32",
            Stored::uint64 => "uint64",
            Stored::bool => "bool",
            Stored::string => "string",
        }
    }

    /// Bytes beside the float of each value, in a field of their own whose number is larger by [`FINE_TAG`].
    pub fn fine_bytes(self) -> usize {
        match self {
            Stored::double48 => 2,
            Stored::double40 => 1,
            Stored::double
            | Stored::float
            | Stored::derived
            | Stored::uint32
            | Stored::uint64
            | Stored::bool
            | Stored::string => 0,
        }
    }
}

/// Number of the field with the fine bytes of a column, less that of the column. No table has as many columns.
pub const FINE_TAG: u32 = 32;

/// When a value holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// At the node.
    Node,
    /// About the node: a mean over the step, what the step worked with.
    Step,
}

/// What kind of number a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnKind {
    /// One that does not depend on where the drive lies and how its parts are counted.
    Value,
    /// A place along y: drives that are shown one below the other are shifted along it.
    Height,
    /// Index of a link.
    Link,
    /// Index into `Header::bodies`.
    Body,
    /// A [`super::frame::Feature`].
    Feature,
    /// A [`super::frame::Segment`].
    Segment,
    /// An account of the ledger: energy of motion.
    Kinetic,
    /// An account of the ledger: energy stored in springs, contacts and oil.
    Elastic,
    /// An account of the ledger: work done on the drive, counted from the first frame.
    WorkIn,
    /// An account of the ledger: work that the drive does on what it drives.
    WorkOut,
    /// An account of the ledger: energy that became heat.
    Lost,
    /// An account of the ledger: what does not add up.
    Error,
}

impl ColumnKind {
    /// Whether an account is a stored energy, with an absolute value; others are counted from where the ledger was opened.
    pub fn is_stored(self) -> bool {
        matches!(self, ColumnKind::Kinetic | ColumnKind::Elastic)
    }
}

/// A message of columns or fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MessageInfo {
    /// Of tables also the field of the frame.
    pub name: &'static str,
    pub struct_name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// In the order of exported tables.
    pub columns: &'static [Column],
}

/// A table of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableInfo {
    /// Number in the schema of the frame.
    pub tag: u32,
    pub rows: Rows,
    pub message: MessageInfo,
}

/// What has a row in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    Link,
    Joint,
    Contact,
    /// A coordinate that turns.
    Rotor,
    /// A coordinate that slides.
    Slider,
    /// Two parts that touch each other and no chain.
    Touch,
    /// A chamber or a reservoir of oil.
    Chamber,
    /// What oil flows through.
    Passage,
    /// A roller that is a body of its own.
    Roller,
    /// A span of a chain without links.
    Span,
}

impl Rows {
    pub fn name(self) -> &'static str {
        match self {
            Rows::Link => "link",
            Rows::Joint => "joint",
            Rows::Contact => "contact",
            Rows::Rotor => "rotor",
            Rows::Slider => "slider",
            Rows::Touch => "touch",
            Rows::Chamber => "chamber",
            Rows::Passage => "passage",
            Rows::Roller => "roller",
            Rows::Span => "span",
        }
    }

    /// Name of the column with the path of what has a row, in exported tables.
    pub fn path_column(self) -> &'static str {
        match self {
            Rows::Link => "link_path",
            Rows::Joint => "joint_path",
            Rows::Contact => "contact_path",
            Rows::Rotor => "rotor_path",
            Rows::Slider => "slider_path",
            Rows::Touch => "touch_path",
            Rows::Chamber => "chamber_path",
            Rows::Passage => "passage_path",
            Rows::Roller => "roller_path",
            Rows::Span => "span_path",
        }
    }

    /// Whether row i is of the same thing in all frames of a recording.
    pub fn are_fixed(self) -> bool {
        match self {
            Rows::Link | Rows::Joint | Rows::Roller | Rows::Rotor => true,
            Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => true,
            Rows::Contact => false,
        }
    }
}

/// ColumnValues of a column; of a field, one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColumnValues<'a> {
    F64(&'a [f64]),
    U32(&'a [u32]),
    U64(&'a [u64]),
    Bool(&'a [bool]),
    Text(&'a [String]),
}

impl ColumnValues<'_> {
    pub fn len(&self) -> usize {
        match self {
            ColumnValues::F64(v) => v.len(),
            ColumnValues::U32(v) => v.len(),
            ColumnValues::U64(v) => v.len(),
            ColumnValues::Bool(v) => v.len(),
            ColumnValues::Text(v) => v.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether all indices of a column are below `n`; true of other columns.
    pub fn are_below(&self, n: usize) -> bool {
        match self {
            ColumnValues::U32(v) => v.iter().all(|v| (*v as usize) < n),
            ColumnValues::F64(_) | ColumnValues::U64(_) | ColumnValues::Bool(_) | ColumnValues::Text(_) => true,
        }
    }

    /// The first row whose bits differ.
    pub fn first_difference(&self, other: &ColumnValues<'_>) -> Option<usize> {
        match (self, other) {
            (ColumnValues::F64(a), ColumnValues::F64(b)) => {
                a.iter().zip(*b).position(|(a, b)| a.to_bits() != b.to_bits())
            }
            (ColumnValues::U32(a), ColumnValues::U32(b)) => a.iter().zip(*b).position(|(a, b)| a != b),
            (ColumnValues::U64(a), ColumnValues::U64(b)) => a.iter().zip(*b).position(|(a, b)| a != b),
            (ColumnValues::Bool(a), ColumnValues::Bool(b)) => a.iter().zip(*b).position(|(a, b)| a != b),
            (ColumnValues::Text(a), ColumnValues::Text(b)) => a.iter().zip(*b).position(|(a, b)| a != b),
            (
                ColumnValues::F64(_)
                | ColumnValues::U32(_)
                | ColumnValues::U64(_)
                | ColumnValues::Bool(_)
                | ColumnValues::Text(_),
                _,
            ) => Some(0),
        }
    }

    /// A value as it is printed.
    pub fn show(&self, row: usize) -> String {
        match self {
            ColumnValues::F64(v) => format!("{:e}", v[row]),
            ColumnValues::U32(v) => v[row].to_string(),
            ColumnValues::U64(v) => v[row].to_string(),
            ColumnValues::Bool(v) => v[row].to_string(),
            ColumnValues::Text(v) => v[row].clone(),
        }
    }
}

/// As [`ColumnValues`], to be changed.
#[derive(Debug)]
pub enum ValuesMut<'a> {
    F64(&'a mut [f64]),
    U32(&'a mut [u32]),
    U64(&'a mut [u64]),
    Bool(&'a mut [bool]),
    Text(&'a mut [String]),
}

impl ValuesMut<'_> {
    /// Changes a column of floats as a whole.
    pub fn all_f64(&mut self, f: impl FnOnce(&mut [f64])) {
        match self {
            ValuesMut::F64(v) => f(v),
            ValuesMut::U32(_) | ValuesMut::U64(_) | ValuesMut::Bool(_) | ValuesMut::Text(_) => {}
        }
    }

    /// Changes the values of a column of floats.
    pub fn each_f64(&mut self, f: impl FnMut(&mut f64)) {
        match self {
            ValuesMut::F64(v) => v.iter_mut().for_each(f),
            ValuesMut::U32(_) | ValuesMut::U64(_) | ValuesMut::Bool(_) | ValuesMut::Text(_) => {}
        }
    }

    /// Changes the values of a column of indices.
    pub fn each_u32(&mut self, f: impl FnMut(&mut u32)) {
        match self {
            ValuesMut::U32(v) => v.iter_mut().for_each(f),
            ValuesMut::F64(_) | ValuesMut::U64(_) | ValuesMut::Bool(_) | ValuesMut::Text(_) => {}
        }
    }
}

/// `From` for slices of one type.
macro_rules! from_slices {
    ($($variant:ident($type:ty)),+) => { $(
        impl<'a> From<&'a [$type]> for ColumnValues<'a> {
            fn from(values: &'a [$type]) -> ColumnValues<'a> {
                ColumnValues::$variant(values)
            }
        }
        impl<'a> From<&'a mut [$type]> for ValuesMut<'a> {
            fn from(values: &'a mut [$type]) -> ValuesMut<'a> {
                ValuesMut::$variant(values)
            }
        }
    )+ };
}
from_slices!(F64(f64), U32(u32), U64(u64), Bool(bool), Text(String));

/// Types in memory by how they are stored.
#[allow(non_camel_case_types)]
pub mod schema {
    pub type double = f64;
    pub type double48 = f64;
    pub type double40 = f64;
    pub type float = f64;
    pub type derived = f64;
    pub type uint32 = u32;
    pub type uint64 = u64;
    pub type string = String;
}

/// The list of columns of a message, from its rows.
macro_rules! columns_of {
    ($name:tt $struct_name:ident $about:literal $($tag:tt $column:ident $type:ident $unit:literal $holds:ident $kind:ident $meaning:literal;)+) => {
        MessageInfo {
            name: stringify!($name),
            struct_name: stringify!($struct_name),
            about: $about.trim_ascii(),
            columns: &[$(Column {
                tag: $tag,
                name: stringify!($column),
                channel: concat!(stringify!($name), ".", stringify!($column)),
                stored: Stored::$type,
                unit: $unit,
                holds: Holds::$holds,
                kind: ColumnKind::$kind,
                meaning: $meaning,
            }),+],
        }
    };
}

/// The frame, its tables, and their columns.
macro_rules! tables {
    ($(
        #[doc = $about:literal]
        $table_tag:tt $table:ident: $TableInfo:ident, a row per $rows:ident {
            $($tag:tt $column:ident: $type:ident, $unit:literal, $holds:ident, $kind:ident, $meaning:literal;)+
        }
    )+) => {
        /// Everything at one node of the simulation. Poses, speeds and penetrations are those there; forces, torques and accelerations are
        /// means over the step about it.
        #[derive(Clone, PartialEq, prost::Message)]
        pub struct Frame {
            /// Step number; `t_s` = step x `Header::step_s`.
            #[prost(uint64, tag = "1")]
            pub step: u64,
            /// Simulated time since the start of the recording [s].
            #[prost(double, tag = "2")]
            pub t_s: f64,
            /// XXH3-64 of the whole State.
            #[prost(fixed64, tag = "3")]
            pub state_hash: u64,
            /// Angle turned by the driver since step 0 [rad].
            #[prost(double, tag = "4")]
            pub crank_angle_rad: f64,
            $(#[doc = $about] #[prost(message, required, tag = $table_tag)] pub $table: $TableInfo,)+
            #[prost(message, required, tag = "9")]
            /// The energy ledger.
            pub energy: Energy,
            /// What every sensor stands at, in SI, before its gain and its errors.
            #[prost(double, repeated, tag = "10")]
            pub sensors: Vec<f64>,
        }

        /// All tables of a frame.
        pub const TABLES: &[TableInfo] = &[$($TableInfo::TABLE),+];

        impl Frame {
            /// Calls `f` with every table and the values of its columns.
            pub fn each_table<'a>(&'a self, mut f: impl FnMut(&'static TableInfo, &[ColumnValues<'a>])) {
                $(f(&$TableInfo::TABLE, &self.$table.values());)+
            }

            /// As [`Frame::each_table`], to be changed.
            pub fn each_table_mut(&mut self, mut f: impl FnMut(&'static TableInfo, &mut [ValuesMut<'_>])) {
                $(f(&$TableInfo::TABLE, &mut self.$table.values_mut());)+
            }

            /// Appends the rows of another frame's tables.
            pub fn append_rows(&mut self, other: &Frame) {
                $($(self.$table.$column.extend_from_slice(&other.$table.$column);)+)+
            }

            /// Gives every table `n` rows.
            #[cfg(test)]
            pub fn resize_tables(&mut self, n: usize) {
                $($(self.$table.$column.resize(n, Default::default());)+)+
            }
        }

        $(
            #[doc = $about]
            #[derive(Clone, Debug, Default, PartialEq)]
            pub struct $TableInfo {
                $(#[doc = concat!($meaning, " [", $unit, "]")] pub $column: Vec<$type>,)+
            }

            impl prost::Message for $TableInfo {
                fn encode_raw(&self, out: &mut impl prost::bytes::BufMut) {
                    let mut bytes = Vec::new();
                    frame_bytes::put_table(Self::TABLE.message.columns, &self.values(), &mut bytes);
                    out.put_slice(&bytes);
                }

                fn merge_field(
                    &mut self,
                    tag: u32,
                    wire_type: prost::encoding::WireType,
                    from: &mut impl prost::bytes::Buf,
                    context: prost::encoding::DecodeContext,
                ) -> Result<(), prost::DecodeError> {
                    let (column, is_fine) = if tag > FINE_TAG { (tag - FINE_TAG, true) } else { (tag, false) };
                    match column {
                        $($tag => {
                            let part = frame_bytes::ColumnPart { stored: Stored::$type, is_fine, wire_type };
                            frame_bytes::MergeColumn::merge(&mut self.$column, part, from, context)
                        })+
                        _ => prost::encoding::skip_field(wire_type, tag, from, context),
                    }
                }

                fn encoded_len(&self) -> usize {
                    frame_bytes::columns_len(Self::TABLE.message.columns, &self.values())
                }

                fn clear(&mut self) {
                    $(self.$column.clear();)+
                }
            }

            impl $TableInfo {
                /// What a table of frames is.
                pub const TABLE: TableInfo = TableInfo {
                    tag: $table_tag,
                    rows: Rows::$rows,
                    message: columns_of!($table $TableInfo $about $($tag $column $type $unit $holds $kind $meaning;)+),
                };

                /// Of every column, in the order of the table.
                pub fn values(&self) -> [ColumnValues<'_>; Self::TABLE.message.columns.len()] {
                    [$(ColumnValues::from(self.$column.as_slice())),+]
                }

                /// The values of its columns, to be changed, in the order of their tags.
                pub fn values_mut(&mut self) -> [ValuesMut<'_>; Self::TABLE.message.columns.len()] {
                    [$(ValuesMut::from(self.$column.as_mut_slice())),+]
                }
            }
        )+
    };
}

/// A message of single values, and its fields.
macro_rules! record {
    (
        #[doc = $about:literal]
        $(#[$attribute:meta])*
        $name:ident: $Record:ident {
            $($tag:tt $column:ident: $type:ident, $unit:literal, $holds:ident, $kind:ident, $meaning:literal;)+
        }
    ) => {
        #[doc = $about]
        $(#[$attribute])*
        #[derive(Clone, PartialEq, prost::Message)]
        pub struct $Record {
            $(#[doc = concat!($meaning, " [", $unit, "]")] #[prost($type, tag = $tag)] pub $column: $type,)+
        }

        impl $Record {
            /// What the message is.
            pub const MESSAGE: MessageInfo =
                columns_of!($name $Record $about $($tag $column $type $unit $holds $kind $meaning;)+);

            /// Of every field, in the order of the record.
            pub fn values(&self) -> [ColumnValues<'_>; Self::MESSAGE.columns.len()] {
                [$(ColumnValues::from(std::slice::from_ref(&self.$column))),+]
            }

            /// The values of its columns, to be changed, in the order of their tags.
            pub fn values_mut(&mut self) -> [ValuesMut<'_>; Self::MESSAGE.columns.len()] {
                [$(ValuesMut::from(std::slice::from_mut(&mut self.$column))),+]
            }
        }
    };
}

pub(super) use {columns_of, record, tables};
