//! The types of configs, read from their sources.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use syn::{
    Attribute, Expr, ExprLit, Fields, GenericArgument, Item, Lit, Meta, PathArguments, Type,
    Visibility,
};

/// The crates whose types are in configs.
const CRATES: [&str; 8] = [
    "pinc-config",
    "pinc-net",
    "pinc-mpc",
    "pinc-qp",
    "pinc-expr",
    "pinc-external",
    "pinc-ode",
    "pinc-estimate",
];

/// Types with a form in files that their fields do not show.
const WRITTEN: [(&str, &str); 7] = [
    ("Variable", "name, or `{ name, unit }`"),
    ("OutputExpression", "output"),
    ("ParameterRange", "`NAME = [low, high]`"),
    ("OwnPlantSpec", "table of parameters by the plant's name"),
    ("Weight", "list of numbers (a diagonal), or list of rows"),
    ("GateSpec", "number, or `\"off\"`"),
    ("Start", "number, or expression"),
];

/// What a value looks like in a file.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// Said as it is: a number, a text.
    Plain(&'static str),
    /// One of the types.
    Named(String),
    List(Box<Self>),
    /// So many in a list.
    Fixed(usize, Box<Self>),
    /// By names.
    Table(Box<Self>),
    Optional(Box<Self>),
}

/// A key of a table.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    pub(crate) key: String,
    pub(crate) doc: String,
    pub(crate) shape: Shape,
    pub(crate) default: Given,
}

/// What serde is told of a key's default.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Given {
    Nothing,
    /// The type's own.
    OfType,
    /// A number or a word that a function returns.
    Value(String),
}

/// A variant of an enum.
#[derive(Clone, Debug)]
pub(crate) struct Word {
    pub(crate) key: String,
    pub(crate) doc: String,
    pub(crate) content: Option<Shape>,
    pub(crate) is_default: bool,
}

/// Structs and enums by name, with their descriptions.
#[derive(Debug, Default)]
pub(crate) struct Types {
    docs: BTreeMap<String, String>,
    fields: BTreeMap<String, Vec<Field>>,
    words: BTreeMap<String, Vec<Word>>,
}

impl Types {
    pub(crate) fn read(root: &Path) -> Self {
        let mut types = Self::default();
        for name in CRATES {
            types.read_folder(&root.join("crates").join(name).join("src"));
        }
        let models = pinc_config::ModelKind::ALL.into_iter().map(|model| Word {
            key: model.to_string(),
            doc: format!("{}.", model.title()),
            content: None,
            is_default: false,
        });
        types.words.insert("ModelKind".to_owned(), models.collect());
        // One table in files.
        let parts = ["TrainingConfig", "Effort"].map(|name| types.fields[name].clone());
        types.fields.insert("TrainingSpec".to_owned(), parts.concat());
        types
    }

    fn read_folder(&mut self, folder: &Path) {
        for entry in fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                self.read_folder(&path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).expect("a source");
                let file = syn::parse_file(&text).expect("a source that compiles");
                self.read_items(&file.items);
            }
        }
    }

    fn read_items(&mut self, items: &[Item]) {
        for item in items {
            match item {
                Item::Struct(of) if is_read(&of.vis, &of.attrs) => {
                    let name = of.ident.to_string();
                    self.docs.insert(name.clone(), doc(&of.attrs));
                    let defaulted = serde(&of.attrs).iter().any(|said| said == "default");
                    let Fields::Named(fields) = &of.fields else { continue };
                    let fields = fields.named.iter().flat_map(|field| {
                        let mut field = Field::of(field, items)?;
                        if defaulted && field.default == Given::Nothing {
                            field.default = Given::OfType;
                        }
                        Some(field)
                    });
                    self.fields.insert(name, fields.collect());
                }
                Item::Enum(of) if is_read(&of.vis, &of.attrs) => {
                    let name = of.ident.to_string();
                    self.docs.insert(name.clone(), doc(&of.attrs));
                    let said = serde(&of.attrs);
                    let kebab = said.iter().any(|said| said == "rename_all=kebab-case");
                    let words = of.variants.iter().map(|variant| Word::of(variant, kebab));
                    self.words.insert(name, words.collect());
                }
                _ => {}
            }
        }
    }

    /// The description of a type.
    pub(crate) fn doc(&self, name: &str) -> &str {
        self.docs.get(name).map_or("", String::as_str)
    }

    /// The keys of a struct; `None` of what is none, or is written
    /// otherwise.
    pub(crate) fn fields(&self, name: &str) -> Option<&[Field]> {
        if WRITTEN.iter().any(|(written, _)| *written == name) {
            return None;
        }
        self.fields.get(name).map(Vec::as_slice)
    }

    /// The variants of an enum; `None` of what is none, or is written otherwise.
    pub(crate) fn words(&self, name: &str) -> Option<&[Word]> {
        if WRITTEN.iter().any(|(written, _)| *written == name) {
            return None;
        }
        self.words.get(name).map(Vec::as_slice)
    }
}

impl Shape {
    fn of(of: &Type) -> Self {
        match of {
            Type::Array(array) => {
                let Expr::Lit(ExprLit { lit: Lit::Int(count), .. }) = &array.len else {
                    panic!("an array of an unknown length")
                };
                Self::Fixed(
                    count.base10_parse().expect("a length"),
                    Box::new(Self::of(&array.elem)),
                )
            }
            Type::Path(path) => {
                let last = path.path.segments.last().expect("a type");
                let arguments: Vec<&Type> = match &last.arguments {
                    PathArguments::AngleBracketed(of) => {
                        let types = of.args.iter().filter_map(|argument| match argument {
                            GenericArgument::Type(of) => Some(of),
                            _ => None,
                        });
                        types.collect()
                    }
                    _ => Vec::new(),
                };
                let inner = || Box::new(Self::of(arguments.last().expect("an argument")));
                match last.ident.to_string().as_str() {
                    "f64" => Self::Plain("number"),
                    "usize" | "u64" | "i64" => Self::Plain("whole number"),
                    "bool" => Self::Plain("true or false"),
                    "String" => Self::Plain("text"),
                    "PathBuf" => Self::Plain("path"),
                    "Value" => Self::Plain("any value"),
                    "Table" => Self::Plain("table"),
                    "Option" => Self::Optional(inner()),
                    "Vec" => Self::List(inner()),
                    "BTreeMap" => Self::Table(inner()),
                    name => Self::Named(name.to_owned()),
                }
            }
            // Of types that are in no config.
            _ => Self::Plain("value"),
        }
    }

    /// The type in it that may have a description of its own.
    pub(crate) fn name(&self) -> Option<&str> {
        match self {
            Self::Plain(_) => None,
            Self::Named(name) => Some(name),
            Self::List(of) | Self::Fixed(_, of) | Self::Table(of) | Self::Optional(of) => of.name(),
        }
    }

    /// Whether it is a table with keys of its own.
    pub(crate) fn is_table(&self) -> bool {
        matches!(self, Self::Named(_))
    }

    /// What the page says of it.
    pub(crate) fn in_words(&self, types: &Types) -> String {
        let several = |of: &Self| match of {
            Self::Plain("number") => "numbers".to_owned(),
            Self::Plain("whole number") => "whole numbers".to_owned(),
            Self::Plain("text") => "texts".to_owned(),
            Self::Plain("path") => "paths".to_owned(),
            Self::Plain("any value") => "values".to_owned(),
            Self::Fixed(..) => format!("lists of {}", of.in_words(types)),
            Self::Named(name) if name == "Variable" => {
                format!("variables: each a {}", of.in_words(types))
            }
            of => format!("{}s", of.in_words(types)),
        };
        match self {
            Self::Plain(words) => (*words).to_owned(),
            Self::Named(name) => match WRITTEN.iter().find(|(written, _)| written == name) {
                Some((_, words)) => (*words).to_owned(),
                None if types.fields(name).is_some() => "table".to_owned(),
                None => word_or_table(types.words(name).unwrap_or_else(|| panic!("{name}?"))),
            },
            Self::List(of) if of.name().is_some_and(|name| types.fields(name).is_some()) => {
                "list of tables".to_owned()
            }
            // In files a table.
            Self::List(of) if of.name() == Some("ParameterRange") => {
                format!("table of {}", of.in_words(types))
            }
            Self::List(of) => format!("list of {}", several(of)),
            Self::Fixed(count, of) => format!("{count} {}", several(of)),
            Self::Table(of) => format!("table of {}", several(of)),
            Self::Optional(of) => of.in_words(types),
        }
    }
}

fn word_or_table(words: &[Word]) -> String {
    let is_table = |word: &Word| word.content.as_ref().is_some_and(Shape::is_table);
    if words.iter().any(is_table) { "table with one key" } else { "word" }.to_owned()
}

impl Field {
    /// The key of a field; `None` if it is not in files. The functions that make defaults are among
    /// `items`.
    fn of(field: &syn::Field, items: &[Item]) -> Option<Self> {
        let said = serde(&field.attrs);
        if said.iter().any(|said| said == "skip") {
            return None;
        }
        let after = |prefix: &str| said.iter().find_map(|said| said.strip_prefix(prefix));
        let name = field.ident.as_ref()?.to_string();
        let default = match after("default=") {
            Some(function) => Given::Value(returned(function, items)),
            None if said.iter().any(|said| said == "default") => Given::OfType,
            None => Given::Nothing,
        };
        let key = after("rename=").map_or(name, str::to_owned);
        Some(Self { key, doc: doc(&field.attrs), shape: Shape::of(&field.ty), default })
    }
}

impl Word {
    fn of(variant: &syn::Variant, kebab: bool) -> Self {
        let said = serde(&variant.attrs);
        let renamed = said.iter().find_map(|said| said.strip_prefix("rename="));
        let name = variant.ident.to_string();
        let mut key = String::new();
        for (i, c) in name.chars().enumerate() {
            if i > 0 && kebab && c.is_uppercase() {
                key.push('-');
            }
            key.extend(c.to_lowercase());
        }
        let content = match &variant.fields {
            Fields::Unnamed(fields) => fields.unnamed.first().map(|field| Shape::of(&field.ty)),
            _ => None,
        };
        let is_default = variant.attrs.iter().any(|of| of.path().is_ident("default"));
        let key = renamed.map_or(key, str::to_owned);
        Self { key, doc: doc(&variant.attrs), content, is_default }
    }
}

/// Whether files are read into a type, or it is part of one that is.
fn is_read(seen: &Visibility, attributes: &[Attribute]) -> bool {
    matches!(seen, Visibility::Public(_))
        && attributes.iter().any(|attribute| match &attribute.meta {
            Meta::List(list) if list.path.is_ident("derive") => {
                let derived = list.tokens.to_string();
                derived.contains("Deserialize") || derived.contains("Serialize")
            }
            _ => false,
        })
}

/// What `#[serde(..)]` says, each as `key` or `key=value`.
fn serde(attributes: &[Attribute]) -> Vec<String> {
    let mut said = Vec::new();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("serde")) {
        let read = attribute.parse_nested_meta(|meta| {
            let key = meta.path.get_ident().map(ToString::to_string).unwrap_or_default();
            match meta.value() {
                Ok(value) => said.push(format!("{key}={}", value.parse::<syn::LitStr>()?.value())),
                Err(_) => said.push(key),
            }
            Ok(())
        });
        read.expect("an attribute of serde");
    }
    said
}

/// The literal that a function returns.
fn returned(function: &str, items: &[Item]) -> String {
    let body = items.iter().find_map(|item| match item {
        Item::Fn(of) if of.sig.ident == function => of.block.stmts.last(),
        _ => None,
    });
    match body {
        Some(syn::Stmt::Expr(Expr::Lit(ExprLit { lit, .. }), None)) => match lit {
            Lit::Bool(value) => value.value.to_string(),
            Lit::Float(value) => value.base10_digits().to_owned(),
            Lit::Int(value) => value.base10_digits().to_owned(),
            _ => panic!("{function}: a literal of another kind"),
        },
        _ => panic!("{function}: no literal"),
    }
}

/// The sentences of a doc comment before its first block of code, on one line, with links as their
/// words.
fn doc(attributes: &[Attribute]) -> String {
    let line = |attribute: &Attribute| match &attribute.meta {
        Meta::NameValue(of) if of.path.is_ident("doc") => match &of.value {
            Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) => Some(text.value()),
            _ => None,
        },
        _ => None,
    };
    let text: Vec<String> = attributes.iter().filter_map(line).collect();
    // A sentence with a block of code in it, and all that follows, is for readers of the sources.
    let prose = text.join("\n");
    let prose = match prose.split_once("```") {
        Some((before, _)) => before.rsplit_once('.').map_or("", |(said, _)| said).to_owned() + ".",
        None => prose,
    };
    let words: Vec<&str> = prose.split_whitespace().collect();
    without_links(&words.join(" "))
}

/// [`name`](place) and [`name`] as `name`.
fn without_links(text: &str) -> String {
    let mut parts = text.split("[`");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("`]").expect("the end of a link");
        let rest = match rest.strip_prefix('(') {
            Some(target) => target.split_once(')').map_or(rest, |(_, rest)| rest),
            None => rest,
        };
        plain += &format!("`{name}`{rest}");
    }
    plain
}
