//! Logic, arithmetic, time and interpolation, one row per type; `docs/from-the-predecessor.md` is generated from it.
//! Used by the loader's threads.

use super::Counterpart::{By, Net, None, Special};
use super::NullReading::{Last, Null, Parameter};
use super::PrimitiveClass::{A, M, S};
use super::{ConversionRow, NoCounterpart, SpecialConversion};

#[rustfmt::skip] // A row a type, readable as a table.
pub(super) const ROWS: &[ConversionRow] = &[
    ConversionRow::new("Cancel", M, "", "outCancel:bool", "")
        .to(Last, Net("{outCancel=Cancel().requested}")),
    ConversionRow::new("EStop", M, "inEStop:bool", "", "")
        .to(Last, None(NoCounterpart::Safety))
        .note("an emergency stop belongs to safety hardware; `rcc-cli abort` aborts all nets"),
    ConversionRow::new("Core::BooleanAnd", M, "inFirst:bool inSecond:bool", "outValue:bool", "First:bool=true Second:bool=true")
        .to(Parameter, Net("{outValue=And(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::BooleanHistory", S, "inValue*:bool", "outAll:bool outAmount:double outNone:bool", "Duration:double=1")
        .to(Last, Net("{w=TrueInWindow(in=parent.inValue,window=parent.Duration),outAll=w.all,outNone=Not(in=w.any).out,outAmount=Select(condition=w.all,yes='1',no='0').out}"))
        .note("`outAmount` is 1 or 0, as in the predecessor, which divides whole numbers"),
    ConversionRow::new("Core::BooleanLastN", S, "inValue*:bool", "outAll:bool outCount:int outNone:bool", "Count:int=1")
        .to(Last, None(NoCounterpart::Rare))
        .note("here a window is a time, independent of the period: `TrueInWindow`"),
    ConversionRow::new("Core::BooleanNot", M, "inValue:bool", "outValue:bool", "Value:bool=false")
        .to(Parameter, Net("{outValue=Not(in=parent.inValue).out}")),
    ConversionRow::new("Core::BooleanOr", M, "inFirst:bool inSecond:bool", "outValue:bool", "First:bool=false Second:bool=false")
        .to(Parameter, Net("{outValue=Or(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::EdgeDetection", S, "inValue*:bool", "outValue:bool", "Direction:bool=true")
        .to(Null, By("Direction", "{outValue=RisingEdge(in=parent.inValue,initial='false').out}", "{outValue=FallingEdge(in=parent.inValue,initial='false').out}")),
    ConversionRow::new("Core::Trigger", S, "inOff:bool inOn:bool", "outActive:bool", "On:bool=false Off:bool=false")
        .to(Parameter, Net("{outActive=Trigger(on=parent.inOn,off=parent.inOff,reset=parent.inReset).out}")),
    ConversionRow::new("Core::BCDToDec", A, "inArray:bool[]", "outValue:int", "amountBits:uint signBit:bool=true")
        .to(Last, None(NoCounterpart::Rare))
        .note("composed of `FromBits` with four bits per digit"),
    ConversionRow::new("Core::BinToDec", A, "inArray:bool[]", "outValue:int", "amountBits:uint signBit:bool=false")
        .to(Last, Net("{outValue=FromBits(in=parent.inArray,signed=parent.signBit).out}"))
        .note("all elements of the array are bits; `amountBits` is ignored"),
    ConversionRow::new("Core::DecToBCD", A, "inValue:int", "outArray:bool[] overflowBit:bool", "amountBits:uint signBit:bool=true")
        .to(Last, None(NoCounterpart::Rare))
        .note("composed of `IntDivide`, `Remainder` and `ToBits` with four bits per digit"),
    ConversionRow::new("Core::DecToBin", A, "inValue:int", "outArray:bool[] overflowBit:bool", "amountBits:uint signBit:bool=false")
        .to(Last, Net("{b=ToBits(in=parent.inValue,bits='8',signed=parent.signBit),outArray=b.out,overflowBit=b.overflow}"))
        .note("8 bits, because `amountBits` cannot be set in the predecessor; a number that does not fit gives its lowest bits, not the previous ones"),
    ConversionRow::new("Core::DoubleAcos", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=ArcCosine(in=parent.inValue).out}"))
        .note("null, not NaN, outside of its range"),
    ConversionRow::new("Core::DoubleAdd", M, "inFirst:double inSecond:double", "outValue:double", "First:double=0 Second:double=0")
        .to(Last, Net("{outValue=Add(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::DoubleAsin", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=ArcSine(in=parent.inValue).out}"))
        .note("null, not NaN, outside of its range"),
    ConversionRow::new("Core::DoubleAtan2", M, "inX:double inY:double", "outValue:double", "Y:double=1 X:double=1")
        .to(Parameter, Net("{outValue=ArcTangent(y=parent.inY,x=parent.inX).out}")),
    ConversionRow::new("Core::DoubleAverage", S, "inValue*:double", "outValue:double", "Duration:double=1")
        .to(Last, Net("{outValue=WindowMean(in=parent.inValue,window=parent.Duration).out}")),
    ConversionRow::new("Core::DoubleCos", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=Cosine(in=parent.inValue).out}")),
    ConversionRow::new("Core::DoubleDivide", M, "inFirst:double inSecond:double", "outValue:double", "First:double=0 Second:double=0")
        .to(Last, Net("{outValue=Divide(a=parent.inFirst,b=parent.inSecond).out}"))
        .note("division by 0 gives null, not inf"),
    ConversionRow::new("Core::DoubleEquals", M, "inFirst:double inSecond:double", "outValue:bool", "First:double=0 Second:double=0 Epsilon:double=0")
        .to(Last, Net("{outValue=Not(in=Greater(a=Abs(in=Subtract(a=parent.inFirst,b=parent.inSecond).out).out,b=parent.Epsilon).out).out}")),
    ConversionRow::new("Core::DoubleFromInt", M, "inValue:int", "outValue:double", "Value:int=1")
        .to(Parameter, Net("{outValue=ToReal(in=parent.inValue).out}")),
    ConversionRow::new("Core::DoubleGreater", M, "inFirst:double inSecond:double", "outValue:bool", "First:double=0 Second:double=0")
        .to(Last, Net("{outValue=Greater(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::DoubleLog", M, "inValue:double", "outValue:double", "Value:double=0")
        .to(Last, Net("{outValue=Logarithm(in=parent.inValue).out}"))
        .note("null, not NaN or -inf, unless the value is positive"),
    ConversionRow::new("Core::DoubleModulo", M, "inFirst:double inSecond:double", "outValue:double", "First:double=1 Second:double=1")
        .to(Parameter, Net("{outValue=Remainder(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::DoubleMultiply", M, "inFirst:double inSecond:double", "outValue:double", "First:double=0 Second:double=0")
        .to(Last, Net("{outValue=Multiply(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::DoublePower", M, "inFirst:double inSecond:double", "outValue:double", "First:double=0 Second:double=0")
        .to(Last, Net("{outValue=Power(base=parent.inFirst,exponent=parent.inSecond).out}")),
    ConversionRow::new("Core::DoubleSin", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=Sine(in=parent.inValue).out}")),
    ConversionRow::new("Core::DoubleSquareRoot", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=SquareRoot(in=parent.inValue).out}"))
        .note("null, not NaN, outside of its range"),
    ConversionRow::new("Core::DoubleTan", M, "inValue:double", "outValue:double", "Value:double=1")
        .to(Parameter, Net("{outValue=Tangent(in=parent.inValue).out}")),
    ConversionRow::new("Core::IntAdd", M, "inFirst:int inSecond:int", "outValue:int", "First:int=0 Second:int=0")
        .to(Last, Net("{outValue=Add(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::IntDivide", M, "inFirst:int inSecond:int", "outValue:int", "First:int=0 Second:int=0")
        .to(Last, Net("{outValue=IntDivide(a=parent.inFirst,b=parent.inSecond).out}")).may_be_null(),
    ConversionRow::new("Core::IntEquals", M, "inFirst:int inSecond:int", "outValue:bool", "First:int=0 Second:int=0 Epsilon:int=0")
        .to(Last, Net("{outValue=Not(in=Greater(a=Abs(in=Subtract(a=parent.inFirst,b=parent.inSecond).out).out,b=parent.Epsilon).out).out}")),
    ConversionRow::new("Core::IntFromDouble", M, "inValue:double", "outValue:int", "Value:double=1")
        .to(Parameter, Net("{outValue=Truncate(in=parent.inValue).out}")),
    ConversionRow::new("Core::IntGreater", M, "inFirst:int inSecond:int", "outValue:bool", "First:int=0 Second:int=0")
        .to(Last, Net("{outValue=Greater(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::IntMultiply", M, "inFirst:int inSecond:int", "outValue:int", "First:int=0 Second:int=0")
        .to(Last, Net("{outValue=Multiply(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("Core::Clock", S, "inIncrement:double", "outValue:double", "Increment:double=1")
        .to(Last, Net("{outValue=Integrator(in=parent.inIncrement,reset=parent.inReset).out}")),
    ConversionRow::new("Core::CycleTime", M, "", "outValue:double", "")
        .to(Last, Net("{outValue=CyclePeriod().out}")),
    ConversionRow::new("Core::TimeAdd", M, "inDelta:double inTime:nsecs", "outValue:nsecs", "")
        .to(Last, Net("{outValue=Add(a=parent.inTime,b=parent.inDelta).out}"))
        .note("times are seconds in a Real"),
    ConversionRow::new("Core::TimeAtTime", M, "inAge:double inValue*:nsecs", "outValue:nsecs", "Age:double=0 MaxAge:double=1")
        .to(Null, Net("{outValue=Delay(in=parent.inValue,age=Add(a=parent.inAge,b=CyclePeriod().out).out,max=parent.MaxAge).out}")).may_be_null()
        .note("one cycle more than `Age`, as in the predecessor; times are seconds in a Real"),
    ConversionRow::new("Core::TimeConsistentRange", S, "inFirstEnd*:nsecs inFirstStart*:nsecs inSecondEnd*:nsecs inSecondStart*:nsecs", "outEnd:nsecs outStart:nsecs", "MaxSize:double=1 MaxAge:double=1")
        .to(Last, None(NoCounterpart::Dead))
        .note("the predecessor never fills its histories, so it never gives a value"),
    ConversionRow::new("Core::TimeDiff", M, "inFirst:nsecs inSecond:nsecs", "outValue:double", "")
        .to(Last, Net("{outValue=Subtract(a=parent.inSecond,b=parent.inFirst).out}"))
        .note("times are seconds in a Real"),
    ConversionRow::new("Core::TimeHistory", S, "inTime:nsecs inValue*:nsecs", "outAge:double", "MaxAge:double=1")
        .to(Last, None(NoCounterpart::Rare))
        .note("no search in histories of times; `Delay` gives the value of a known age"),
    ConversionRow::new("Core::TimeNet", M, "", "outValue:nsecs", "")
        .to(Last, Net("{outValue=Time().out}"))
        .note("seconds since START instead of nanoseconds since the executor began"),
    ConversionRow::new("Core::TimePre", S, "inValue:nsecs", "outValue:nsecs", "")
        .to(Null, Special(SpecialConversion::Pre)).may_be_null()
        .note("null in the first cycle"),
    ConversionRow::new("Core::TimeWall", M, "", "outValue:nsecs", "")
        .to(Last, None(NoCounterpart::Clock))
        .note("a cycle reads no clock, so that the same inputs give the same values; use `Core::TimeNet`"),
    ConversionRow::new("Core::CubicBezier", A, "inControl1:double inControl2:double inFrom:double inTo:double inValue*:double", "outValue:double", "From:double=0 To:double=0 Control1:double=0 Control2:double=0")
        .to(Last, Net("{outValue=CubicBezier(from=parent.inFrom,control1=parent.inControl1,control2=parent.inControl2,to=parent.inTo,t=parent.inValue).out}")),
    ConversionRow::new("Core::DoubleBezier", M, "inFrom:double inFromVel:double inTo:double inToVel:double inValue*:double", "outValue:double", "From:double=0 To:double=0 FromVel:double=0 ToVel:double=0")
        .to(Last, Net("{outValue=CubicHermite(from=parent.inFrom,from_slope=parent.inFromVel,to=parent.inTo,to_slope=parent.inToVel,t=parent.inValue).out}")),
    ConversionRow::new("Core::Interval", A, "inMax:double inMin:double inValue*:double", "outActive:bool outValue:double", "Min:double=0 Max:double=1000")
        .to(Last, Net("{i=Interval(in=parent.inValue,low=parent.inMin,high=parent.inMax),outActive=i.inside,outValue=i.fraction}")),
    ConversionRow::new("Core::Lerp", A, "inAmount*:double inFrom:double inTo:double", "outValue:double", "From:double=0 To:double=0")
        .to(Last, Net("{outValue=Lerp(from=parent.inFrom,to=parent.inTo,t=parent.inAmount).out}")),
    ConversionRow::new("Core::OTG", A, "inCurAcc:double inCurPos:double inCurVel:double inDestPos:double inDestVel:double inMaxAcc:double inMaxVel:double", "outAcc:double outPos:double outVel:double", "maxVel:double=0 maxAcc:double=0")
        .to(Last, Net("{o=OnlineTrajectory(goal=parent.inDestPos,goal_velocity=parent.inDestVel,max_velocity=Else(link=parent.inMaxVel,otherwise=parent.maxVel).x,max_acceleration=Else(link=parent.inMaxAcc,otherwise=parent.maxAcc).x,reset_to=Else(link=parent.inCurPos,otherwise=parent.inDestPos).x),outPos=o.position,outVel=o.velocity,outAcc=o.acceleration}"))
        .note("it starts at `inCurPos`, at rest whatever `inCurVel` and `inCurAcc` are, and continues from its own set-point"),
    ConversionRow::new("Core::OTG2", A, "inCurPos:double inCurVel:double inDesPos:double inMaxAcc:double inMaxVel:double", "outAcc:double outPos:double outVel:double", "maxVel:double=0 maxAcc:double=0")
        .to(Last, Net("{o=OnlineTrajectory(goal=parent.inDesPos,max_velocity=Else(link=parent.inMaxVel,otherwise=parent.maxVel).x,max_acceleration=Else(link=parent.inMaxAcc,otherwise=parent.maxAcc).x,reset_to=Else(link=parent.inCurPos,otherwise=parent.inDesPos).x),outPos=o.position,outVel=o.velocity,outAcc=o.acceleration}"))
        .note("as `Core::OTG`, to a goal that does not move"),
    ConversionRow::new("Core::Rampify", A, "inValue*:double", "outValue:double", "Constant:double=0.5")
        .to(Last, Net("{outValue=TrapezoidalProgress(in=parent.inValue,constant=parent.Constant).out}")),
    ConversionRow::new("Core::MatrixApply", M, "inMatrix*:matrix inVector*:double[]", "outValue:double[]", "Size:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixArrayGet", M, "inMatrix*:matrix", "outArray:double[]", "StartRow:int=0 StartCol:int=0 BlockWidth:int=1 Size:int=1")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixArraySet", M, "inArray*:double[] inMatrix*:matrix", "outMatrix:matrix", "Rows:int=0 Cols:int=0 StartRow:int=0 StartCol:int=0 BlockWidth:int=1 Array:double[]=[]")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixBlockGet", M, "inMatrix*:matrix", "outMatrix:matrix", "StartRow:int=0 StartCol:int=0 BlockWidth:int=1 BlockHeight:int=1")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixBlockSet", M, "inBlock*:matrix inMatrix*:matrix", "outMatrix:matrix", "Rows:int=0 Cols:int=0 StartRow:int=0 StartCol:int=0 BlockWidth:int=1 BlockHeight:int=1")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixCreate", M, "", "outMatrix:matrix", "Rows:int=1 Cols:int=1")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixGet", M, "inMatrix*:matrix", "outValue:double", "Row:int=0 Col:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixMultiply", M, "inMatrix1*:matrix inMatrix2*:matrix", "outMatrix:matrix", "Rows:int=0 Cols:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixScale", M, "inMatrix*:matrix inValue:double", "outMatrix:matrix", "Rows:int=0 Cols:int=0 Value:double=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixSelect", M, "inMatrix*:matrix", "outMatrix:matrix", "RowDimension:int=0 ColumnDimension:int=0 SelectedRows:int[]=[] SelectedCols:int[]=[]")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixSet", M, "inMatrix*:matrix inValue*:double", "outMatrix:matrix", "Rows:int=0 Cols:int=0 Row:int=0 Col:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixSolve", M, "inMatrix*:matrix inResult*:double[]", "outValue:double[]", "Size:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
    ConversionRow::new("Core::MatrixTranspose", M, "inMatrix*:matrix", "outMatrix:matrix", "Rows:int=0 Cols:int=0")
        .to(Last, None(NoCounterpart::Library))
        .note("only the Java core has it, and no net of the library uses it; matrices are `Real[r,c]` here"),
];
