//! Drivers may contract a * b + c, which then is rounded once instead of twice. What has to hold to the bit does so, in
//! whichever way they do: the functions of the shaders are evaluated as they stand, and contracted on purpose.

mod common;

use common::random::Random;
use lightsheaf::gpu::{Source, link_source};
use naga::{BinaryOperator, Expression, Function, Handle, Literal, MathFunction, Statement};

/// Which product of a sum or difference is not rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contracted {
    None,
    Left,
    Right,
}

impl Contracted {
    /// Returns p q - r s.
    fn difference(self, [p, q, r, s]: [f32; 4]) -> f32 {
        match self {
            Self::None => p * q - r * s,
            Self::Left => p.mul_add(q, -(r * s)),
            Self::Right => (-r).mul_add(s, p * q),
        }
    }
}

/// A function without statements beside its result, and its arguments.
struct Call<'a> {
    function: &'a Function,
    arguments: &'a [Vec<f32>],
    contracted: Contracted,
}

impl Call<'_> {
    /// Returns the components of the function's result.
    fn result(&self) -> Vec<f32> {
        let value = self.function.body.iter().find_map(|statement| match statement {
            Statement::Return { value } => *value,
            _ => None,
        });
        self.value(value.unwrap())
    }

    fn value(&self, handle: Handle<Expression>) -> Vec<f32> {
        match &self.function.expressions[handle] {
            Expression::FunctionArgument(n) => self.arguments[*n as usize].clone(),
            Expression::Literal(Literal::F32(value)) => vec![*value],
            Expression::AccessIndex { base, index } => vec![self.value(*base)[*index as usize]],
            Expression::Splat { size, value } => self.value(*value).repeat(*size as usize),
            Expression::Binary { op, left, right } => self.binary(*op, *left, *right),
            Expression::Math { fun: MathFunction::Cross, arg, arg1: Some(arg1), .. } => {
                let (a, b) = (self.value(*arg), self.value(*arg1));
                let component = |[i, j]: [usize; 2]| self.contracted.difference([a[i], b[j], a[j], b[i]]);
                [[1, 2], [2, 0], [0, 1]].map(component).into()
            }
            other => panic!("{other:?} has to be evaluated, too"),
        }
    }

    fn binary(&self, op: BinaryOperator, left: Handle<Expression>, right: Handle<Expression>) -> Vec<f32> {
        if let (BinaryOperator::Subtract, Some([p, q]), Some([r, s])) = (op, self.factors(left), self.factors(right)) {
            return broadcast(&[p, q, r, s]).map(|factors| self.contracted.difference(factors)).collect();
        }
        let apply = |[a, b]: [f32; 2]| match op {
            BinaryOperator::Add => a + b,
            BinaryOperator::Subtract => a - b,
            BinaryOperator::Multiply => a * b,
            _ => panic!("{op:?} has to be evaluated, too"),
        };
        broadcast(&[self.value(left), self.value(right)]).map(apply).collect()
    }

    /// Returns the factors of a product.
    fn factors(&self, handle: Handle<Expression>) -> Option<[Vec<f32>; 2]> {
        match self.function.expressions[handle] {
            Expression::Binary { op: BinaryOperator::Multiply, left, right } => {
                Some([self.value(left), self.value(right)])
            }
            _ => None,
        }
    }
}

/// Returns the components of values, of which scalars are repeated.
fn broadcast<const N: usize>(values: &[Vec<f32>; N]) -> impl Iterator<Item = [f32; N]> {
    let components = values.iter().map(Vec::len).max().unwrap_or(0);
    (0..components).map(move |i| std::array::from_fn(|n| values[n][i.min(values[n].len() - 1)]))
}

/// Links functions of the shaders, and one that rounds differently from either end of an edge once it is contracted.
fn linked() -> naga::Module {
    const TEXT: &str = "
        import package::lib::views::edge_functions::{spanned, wedge};
        import package::lib::pixels::film::add_to_film;
        fn planted(a: vec2f, b: vec2f) -> f32 { return a.x * b.y - a.y * b.x; }
        @compute @workgroup_size(1) fn main() {
            let a = vec3f(1.0);
            add_to_film(0u, spanned(a, a) + wedge(a.xy, a.xy) + planted(a.xy, a.xy));
        }";
    let wgsl = link_source(&Source::Text("contraction", TEXT), &[]).unwrap();
    naga::front::wgsl::parse_str(&wgsl).unwrap_or_else(|error| panic!("{}", error.emit_to_string(&wgsl)))
}

fn function<'a>(module: &'a naga::Module, name: &str) -> &'a Function {
    module.functions.iter().find(|(_, function)| function.name.as_deref() == Some(name)).unwrap().1
}

/// Returns the share of edges of which two triangles disagree.
fn disagreement(function: &Function, components: usize, contracted: Contracted) -> f64 {
    const EDGES: u32 = 20_000;
    let mut random = Random(7);
    let mut corner = || (0..components).map(|_| random.between(-40.0, 40.0)).collect::<Vec<_>>();
    let disagree = |_: &u32| {
        let (a, b) = (corner(), corner());
        let from = |ends: [&Vec<f32>; 2]| {
            let arguments = ends.map(Clone::clone);
            Call { function, arguments: &arguments, contracted }.result()
        };
        let back: Vec<f32> = from([&b, &a]).iter().map(|value| -value).collect();
        from([&a, &b]) != back
    };
    (0..EDGES).filter(disagree).count() as f64 / f64::from(EDGES)
}

/// Triangles agree about the edge that they share: from either end only the sign differs.
#[test]
fn neighbours_agree_about_their_edge() {
    let module = linked();
    for contracted in [Contracted::None, Contracted::Left, Contracted::Right] {
        for (name, components) in [("spanned", 3), ("wedge", 2)] {
            assert_eq!(disagreement(function(&module, name), components, contracted), 0.0, "{name}, {contracted:?}");
        }
        let planted = disagreement(function(&module, "planted"), 2, contracted);
        assert_eq!(planted > 0.1, contracted != Contracted::None, "the planted one, {contracted:?}: {planted}");
    }
}

/// A compensated sum has no product that could be contracted with its differences.
#[test]
fn compensated_sums_have_no_products() {
    let module = linked();
    let sum = function(&module, "add_to_film");
    let floats = |handle: Handle<Expression>| !matches!(sum.expressions[handle], Expression::Literal(Literal::U32(_)));
    let products = |e: &Expression| match e {
        Expression::Binary { op: BinaryOperator::Multiply, left, right } => floats(*left) && floats(*right),
        Expression::Math { .. } => true,
        _ => false,
    };
    let found = sum.expressions.iter().filter(|(_, e)| products(e)).count();
    let differences = sum.expressions.iter();
    let differences =
        differences.filter(|(_, e)| matches!(e, Expression::Binary { op: BinaryOperator::Subtract, .. })).count();
    assert_eq!((found, differences), (0, 3), "value - excess, sum - before, that - added");
}
