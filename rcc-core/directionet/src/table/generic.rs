//! The families: 21 types for each of eight element types, which a row calls `T`, one row per type.
//! `docs/from-the-predecessor.md` is generated from it. Used by the loader's threads.

use super::Counterpart::{Net, Special};
use super::NullReading::{Last, Null};
use super::PrimitiveClass::{M, S};
use super::{ConversionRow, SpecialConversion};

#[rustfmt::skip] // A row a type, readable as a table.
pub(super) const ROWS: &[ConversionRow] = &[
    ConversionRow::new("Value", M, "", "outValue:T", "Value:T")
        .to(Last, Net("{outValue=parent.Value}"))
        .note("becomes a constant where it is read"),
    ConversionRow::new("IsNull", M, "inValue*:T", "outValue:bool", "")
        .to(Null, Net("{outValue=IsNull(in=parent.inValue).out}")),
    ConversionRow::new("SetNull", M, "inNull*:bool inValue*:T", "outValue:T", "")
        .to(Null, Net("{outValue=NullIf(in=parent.inValue,condition=parent.inNull).out}")).may_be_null(),
    ConversionRow::new("AtTime", M, "inAge:double inValue*:T", "outValue:T", "Age:double=0 MaxAge:double=1")
        .to(Null, Net("{outValue=Delay(in=parent.inValue,age=Add(a=parent.inAge,b=CyclePeriod().out).out,max=parent.MaxAge).out}")).may_be_null()
        .note("one cycle more than `Age`, as in the predecessor; the age is rounded to whole cycles"),
    ConversionRow::new("Snapshot", S, "inSnapshot*:bool inValue*:T", "outValue:T", "Value:T")
        .to(Null, Net("{outValue=Hold(in=parent.inValue,sample=parent.inSnapshot,initial=parent.Value).out}"))
        .note("before the first snapshot it is `Value`, as the predecessor documents it (its core gives 0)"),
    ConversionRow::new("Pre", S, "inValue:T", "outValue:T", "")
        .to(Null, Special(SpecialConversion::Pre)).may_be_null()
        .note("null in the first cycle"),
    ConversionRow::new("Array", M, "", "outArray:T[]", "Size:int=1")
        .to(Last, Special(SpecialConversion::Array))
        .note("elements start as 0 or false; those of the predecessor are random"),
    ConversionRow::new("ArrayGet", M, "inArray*:T[]", "outValue:T", "Size:int=1 Index:int=0")
        .to(Last, Special(SpecialConversion::ArrayGet))
        .note("`x.out[2]`"),
    ConversionRow::new("ArraySet", M, "inArray*:T[] inValue*:T", "outArray:T[]", "Size:int=1 Index:int=0")
        .to(Last, Special(SpecialConversion::ArraySet))
        .note("`[a.out, b.out]`"),
    ConversionRow::new("ArrayIsNull", M, "inValue*:T[]", "outValue:bool", "")
        .to(Null, Special(SpecialConversion::ArrayIsNull)),
    ConversionRow::new("ArraySetNull", M, "inNull:bool inValue*:T[]", "outValue:T[]", "Size:int=1")
        .to(Null, Special(SpecialConversion::ArraySetNull)).may_be_null(),
    ConversionRow::new("ArraySlice", M, "inArray*:T[]", "outArray:T[]", "Size:int=1 Start:int=0")
        .to(Last, Special(SpecialConversion::ArraySlice)),
    ConversionRow::new("Conditional", M, "inCondition*:bool inFalse:T inTrue:T", "outValue:T", "True:T False:T")
        .to(Last, Net("{outValue=Select(condition=parent.inCondition,yes=parent.inTrue,no=parent.inFalse).out}")),
    ConversionRow::new("NetcommIn", M, "", "outLastUpdated:nsecs outValue:T", "Key:string= Value:T")
        .to(Last, Special(SpecialConversion::NetcommIn))
        .note("its id is `in<Key>`; `outLastUpdated` has no counterpart: read `age`"),
    ConversionRow::new("ArrayNetcommIn", M, "", "outLastUpdated:nsecs outValue:T[]", "Key:string= Value:T[]=[]")
        .to(Last, Special(SpecialConversion::NetcommIn))
        .note("as for single values; the length is that of `Value`"),
    ConversionRow::new("NetcommOut", M, "inValue:T", "", "Key:string= Report:bool=true Value:T")
        .to(Null, Special(SpecialConversion::NetcommOut))
        .note("its id is `out<Key>`; with `Report` false it is a `Publish` for other nets, with the topic `<net>/out<Key>`"),
    ConversionRow::new("ArrayNetcommOut", M, "inValue:T[]", "", "Key:string= Report:bool=true Value:T[]=[]")
        .to(Null, Special(SpecialConversion::NetcommOut))
        .note("its id is `out<Key>`; with `Report` false it is a `Publish` for other nets, with the topic `<net>/out<Key>`"),
    ConversionRow::new("InterNetcommIn", M, "", "outLastUpdated:nsecs outValue:T", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Last, Special(SpecialConversion::InterNetcommIn)).may_be_null()
        .note("the topic is `<RemoteNet>/out<RemoteKey>`: the value that this net publishes with a NetcommOut whose `Report` is false; `outLastUpdated` has no counterpart: read `age`"),
    ConversionRow::new("ArrayInterNetcommIn", M, "", "outLastUpdated:nsecs outValue:T[]", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Last, Special(SpecialConversion::InterNetcommIn)).may_be_null()
        .note("the topic is `<RemoteNet>/out<RemoteKey>`: the value that this net publishes with a NetcommOut whose `Report` is false; `outLastUpdated` has no counterpart: read `age`"),
    ConversionRow::new("InterNetcommOut", M, "inValue:T", "", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Null, Special(SpecialConversion::InterNetcommOut))
        .note("the topic is `<RemoteNet>/in<RemoteKey>`; that net reads it with a `Subscribe`, because a NetcommIn is set by the application alone"),
    ConversionRow::new("ArrayInterNetcommOut", M, "inValue:T[]", "", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Null, Special(SpecialConversion::InterNetcommOut))
        .note("the topic is `<RemoteNet>/in<RemoteKey>`; that net reads it with a `Subscribe`, because a NetcommIn is set by the application alone"),
];
