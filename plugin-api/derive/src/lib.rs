//! The derives of Puncta's plugin SDK: `Params` for a parameter struct, `Choice` for an enum.
//!
//! ```text
//! #[derive(Params)]
//! struct Histogram {
//!     /// Side of a pixel.
//!     #[param(default = 10.0, min = 0.1, max = 10000.0, unit = "nm")]
//!     pixel_size: f64,
//! }
//! ```
//!
//! Attributes of a field: `default = <expression>` (else it must be given, or is null if the type is
//! an `Option`), `min`, `max`, `unit`, `label`, `input` (the port of a column) and `advanced`. The
//! doc comment is the help text. `flatten` puts the parameters of a field whose type derives `Params`
//! itself in the field's place, so that operations can share them.

use proc_macro::TokenStream;
use proc_macro2::TokenStream as Tokens;
use quote::quote;
use syn::{Data, DeriveInput, Expr, Field, Fields, LitStr, parse_macro_input, spanned::Spanned};

/// Derives `puncta_sdk::Params` for a struct with named fields or without fields.
#[proc_macro_derive(Params, attributes(param))]
pub fn params(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    derive_params(&input)
        .unwrap_or_else(|error| error.to_compile_error())
        .into()
}

/// Derives `puncta_sdk::FromValue` for an enum without data; names become snake_case.
#[proc_macro_derive(Choice)]
pub fn choice(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    derive_choice(&input)
        .unwrap_or_else(|error| error.to_compile_error())
        .into()
}

fn derive_params(input: &DeriveInput) -> syn::Result<Tokens> {
    let Data::Struct(data) = &input.data else {
        return Err(syn::Error::new(
            input.span(),
            "Params is derived for structs",
        ));
    };
    let fields: Vec<&Field> = match &data.fields {
        Fields::Named(named) => named.named.iter().collect(),
        Fields::Unit => Vec::new(),
        Fields::Unnamed(_) => {
            return Err(syn::Error::new(data.fields.span(), "parameters need names"));
        }
    };
    let name = &input.ident;
    let mut schema = Vec::new();
    let mut reads = Vec::new();
    for field in fields {
        let (one, read) = parameter(field)?;
        schema.push(one);
        reads.push(read);
    }
    let body = if matches!(data.fields, Fields::Unit) {
        quote!(Self)
    } else {
        quote!(Self { #(#reads),* })
    };
    Ok(quote! {
        impl ::puncta_sdk::Params for #name {
            fn schema() -> ::std::vec::Vec<::puncta_sdk::documents::Parameter> {
                #[allow(unused_mut)]
                let mut all = ::std::vec::Vec::new();
                #(#schema)*
                all
            }
            fn from_values(
                values: &::puncta_sdk::documents::Map,
            ) -> ::std::result::Result<Self, ::puncta_sdk::Failure> {
                let _ = values;
                ::std::result::Result::Ok(#body)
            }
        }
    })
}

fn parameter(field: &Field) -> syn::Result<(Tokens, Tokens)> {
    let ident = field
        .ident
        .as_ref()
        .ok_or_else(|| syn::Error::new(field.span(), "parameters need names"))?;
    let name = ident.to_string();
    let type_ = &field.ty;
    let help = docs(&field.attrs);
    let mut settings = Vec::new();
    let mut flatten = false;
    for attribute in field.attrs.iter().filter(|a| a.path().is_ident("param")) {
        attribute.parse_nested_meta(|meta| {
            if meta.path.is_ident("flatten") {
                flatten = true;
                return Ok(());
            }
            if meta.path.is_ident("advanced") {
                settings.push(quote!(parameter.advanced = true;));
                return Ok(());
            }
            let value = meta.value()?;
            if meta.path.is_ident("default") {
                let value: Expr = value.parse()?;
                settings.push(quote! {
                    parameter.default = ::std::option::Option::Some(
                        ::puncta_sdk::params::default_value::<#type_>(#value),
                    );
                });
            } else if meta.path.is_ident("min") || meta.path.is_ident("max") {
                let key = &meta.path;
                let value: Expr = value.parse()?;
                settings.push(quote! {
                    parameter.#key = ::std::option::Option::Some((#value) as f64);
                });
            } else if ["unit", "label", "input"]
                .iter()
                .any(|key| meta.path.is_ident(key))
            {
                let key = &meta.path;
                let value: LitStr = value.parse()?;
                settings.push(quote! {
                    parameter.#key = ::std::option::Option::Some(#value.into());
                });
            } else {
                return Err(meta
                    .error("there are default, min, max, unit, label, input, advanced, flatten"));
            }
            Ok(())
        })?;
    }
    if flatten {
        let schema = quote!(all.extend(<#type_ as ::puncta_sdk::Params>::schema()););
        let read = quote!(#ident: <#type_ as ::puncta_sdk::Params>::from_values(values)?);
        return Ok((schema, read));
    }
    let schema = quote! {
        let mut parameter = <#type_ as ::puncta_sdk::FromValue>::parameter(#name);
        parameter.help = #help.into();
        #(#settings)*
        all.push(parameter);
    };
    let read = quote!(#ident: ::puncta_sdk::params::read(values, #name)?);
    Ok((schema, read))
}

fn derive_choice(input: &DeriveInput) -> syn::Result<Tokens> {
    let Data::Enum(data) = &input.data else {
        return Err(syn::Error::new(input.span(), "Choice is derived for enums"));
    };
    let name = &input.ident;
    let mut choices = Vec::new();
    let mut arms = Vec::new();
    let mut names = Vec::new();
    for variant in &data.variants {
        if !matches!(variant.fields, Fields::Unit) {
            return Err(syn::Error::new(variant.span(), "a choice has no data"));
        }
        let ident = &variant.ident;
        let value = snake(&ident.to_string());
        let help = docs(&variant.attrs);
        choices.push(quote! {
            ::puncta_sdk::documents::schema::Choice { value: #value.into(), help: #help.into() }
        });
        arms.push(quote!(::std::option::Option::Some(#value) => ::std::option::Option::Some(#name::#ident)));
        names.push(quote!(#name::#ident => #value));
    }
    Ok(quote! {
        impl ::puncta_sdk::params::IntoDefault<#name> for #name {
            fn into_default(self) -> #name {
                self
            }
        }
        impl ::puncta_sdk::FromValue for #name {
            fn parameter(name: &str) -> ::puncta_sdk::documents::Parameter {
                let mut parameter = ::puncta_sdk::documents::Parameter::new(
                    name,
                    ::puncta_sdk::documents::ParameterKind::Choice,
                );
                parameter.choices = ::std::vec![#(#choices),*];
                parameter
            }
            fn from_value(value: &::puncta_sdk::serde_json::Value) -> ::std::option::Option<Self> {
                match value.as_str() {
                    #(#arms,)*
                    _ => ::std::option::Option::None,
                }
            }
            fn to_value(&self) -> ::puncta_sdk::serde_json::Value {
                ::puncta_sdk::serde_json::Value::from(match self { #(#names),* })
            }
        }
    })
}

/// The doc comment as one line per paragraph.
fn docs(attributes: &[syn::Attribute]) -> String {
    let mut text = String::new();
    for attribute in attributes.iter().filter(|a| a.path().is_ident("doc")) {
        if let syn::Meta::NameValue(pair) = &attribute.meta
            && let Expr::Lit(literal) = &pair.value
            && let syn::Lit::Str(line) = &literal.lit
        {
            let line = line.value();
            let line = line.trim();
            if line.is_empty() {
                text.push('\n');
            } else {
                if !text.is_empty() && !text.ends_with('\n') {
                    text.push(' ');
                }
                text.push_str(line);
            }
        }
    }
    text.trim().to_owned()
}

fn snake(name: &str) -> String {
    let mut out = String::new();
    for (place, letter) in name.char_indices() {
        if letter.is_uppercase() && place > 0 {
            out.push('_');
        }
        out.extend(letter.to_lowercase());
    }
    out
}
