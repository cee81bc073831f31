//! The mathematical functions of the WebAssembly module, those of Zig's own library. A native
//! library of the same functions is what the module's bits are compared with.

const std = @import("std");

export fn pter_sin(x: f64) f64 {
    return @sin(x);
}

export fn pter_cos(x: f64) f64 {
    return @cos(x);
}

export fn pter_exp(x: f64) f64 {
    return @exp(x);
}

export fn pter_log(x: f64) f64 {
    return @log(x);
}

export fn pter_atan2(y: f64, x: f64) f64 {
    return std.math.atan2(y, x);
}

/// Compilers for this computer make one call of a sine and a cosine of one angle.
export fn pter_sincos(x: f64, sine: *f64, cosine: *f64) void {
    sine.* = @call(.never_inline, pter_sin, .{x});
    cosine.* = @call(.never_inline, pter_cos, .{x});
}
