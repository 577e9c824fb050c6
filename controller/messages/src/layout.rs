//! Messages and enums as tables: types, sizes, offsets, values and what they mean. The macros that define them
//! write the tables too, so that `controller layout` cannot tell anything else than what is on the wire, and assert
//! at compile time that `repr(C)` hides no padding.

/// Type of a field, or of the items of its array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 32 bits.
    U32,
    /// Unsigned, 64 bits.
    U64,
    /// IEEE 754, 64 bits.
    F64,
    /// Another message.
    Message(&'static str),
}

impl Scalar {
    /// As Rust calls it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::F64 => "f64",
            Self::Message(name) => name,
        }
    }
}

/// A field of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldLayout {
    /// Name of the message's type.
    pub message: &'static str,
    /// Name of the field.
    pub field: &'static str,
    /// Offset from the start of the message \[bytes\].
    pub offset: usize,
    /// Size of the field \[bytes\].
    pub size: usize,
    /// Its type, or that of its items.
    pub scalar: Scalar,
    /// How many items it has; `None` where it is no array.
    pub count: Option<usize>,
    /// What it means, line by line, as documentation has it.
    pub doc: &'static [&'static str],
}

/// A message.
#[derive(Debug, Clone, Copy)]
pub struct MessageLayout {
    /// Name of its type in this crate.
    pub name: &'static str,
    /// Name of its type on the wire, with its version.
    pub type_name: &'static str,
    /// Its size \[bytes\].
    pub size: usize,
    /// What it means, line by line.
    pub doc: &'static [&'static str],
    /// Its fields, in order; they fill it completely.
    pub fields: &'static [FieldLayout],
}

/// A value of an enum.
#[derive(Debug, Clone, Copy)]
pub struct ValueLayout {
    /// Its name.
    pub name: &'static str,
    /// Its number on the wire.
    pub value: u32,
    /// What it means, line by line.
    pub doc: &'static [&'static str],
}

/// An enum.
#[derive(Debug, Clone, Copy)]
pub struct EnumLayout {
    /// Its name.
    pub name: &'static str,
    /// What it means, line by line.
    pub doc: &'static [&'static str],
    /// Its values, in order of their numbers.
    pub values: &'static [ValueLayout],
}

/// What a field may be of.
pub(crate) trait Wire {
    const SCALAR: Scalar;
    const COUNT: Option<usize> = None;
}

impl Wire for u8 {
    const SCALAR: Scalar = Scalar::U8;
}

impl Wire for u32 {
    const SCALAR: Scalar = Scalar::U32;
}

impl Wire for u64 {
    const SCALAR: Scalar = Scalar::U64;
}

impl Wire for f64 {
    const SCALAR: Scalar = Scalar::F64;
}

impl<T: Wire, const N: usize> Wire for [T; N] {
    const SCALAR: Scalar = T::SCALAR;
    const COUNT: Option<usize> = Some(N);
}

/// Defines a message with its name on the wire.
macro_rules! message {
    (
        $(#[doc = $doc:literal])*
        $(derive($($derived:ident),+))? struct $name:ident = $type_name:literal {
            $($(#[doc = $field_doc:literal])* $field:ident: $type:ty,)+
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, ZeroCopySend $($(, $derived)+)?)]
        #[type_name($type_name)]
        #[repr(C)]
        pub struct $name { $($(#[doc = $field_doc])* pub $field: $type,)+ }

        impl $crate::layout::Wire for $name {
            const SCALAR: $crate::layout::Scalar =
                $crate::layout::Scalar::Message(stringify!($name));
        }

        impl $name {
            /// What it looks like on the wire.
            pub const LAYOUT: $crate::layout::MessageLayout = $crate::layout::MessageLayout {
                name: stringify!($name),
                type_name: $type_name,
                size: size_of::<Self>(),
                doc: &[$($doc),*],
                fields: &[$($crate::layout::FieldLayout {
                    message: stringify!($name),
                    field: stringify!($field),
                    offset: core::mem::offset_of!($name, $field),
                    size: size_of::<$type>(),
                    scalar: <$type as $crate::layout::Wire>::SCALAR,
                    count: <$type as $crate::layout::Wire>::COUNT,
                    doc: &[$($field_doc),*],
                }),+],
            };
        }

        const _: () = {
            let mut end = 0;
            $(
                assert!(core::mem::offset_of!($name, $field) == end, "hidden padding");
                end += size_of::<$type>();
            )+
            assert!(size_of::<$name>() == end, "hidden padding at the end");
            assert!(align_of::<$name>() <= 8);
        };
    };
}

/// Defines an enum of numbers on the wire; the first one is the default.
macro_rules! wire_enum {
    (
        $(#[doc = $doc:literal])*
        $name:ident {
            $($(#[doc = $value_doc:literal])+ $variant:ident = $value:literal),+ $(,)?
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u32)]
        pub enum $name { $($(#[doc = $value_doc])+ $variant = $value),+ }

        impl Default for $name {
            fn default() -> Self {
                Self::ALL[0]
            }
        }

        impl $name {
            /// Every variant, in order of its number.
            pub const ALL: &[Self] = &[$(Self::$variant),+];
            /// What it looks like on the wire.
            pub const LAYOUT: $crate::layout::EnumLayout = $crate::layout::EnumLayout {
                name: stringify!($name),
                doc: &[$($doc),*],
                values: &[$($crate::layout::ValueLayout {
                    name: stringify!($variant),
                    value: $value,
                    doc: &[$($value_doc),+],
                }),+],
            };
            /// The variant of this number, `None` when there is none.
            #[must_use]
            pub const fn from_wire(value: u32) -> Option<Self> {
                match value { $($value => Some(Self::$variant),)+ _ => None }
            }
            /// The number on the wire.
            #[must_use]
            pub const fn to_wire(self) -> u32 { self as u32 }
        }
    };
}

pub(crate) use {message, wire_enum};
