//! The families: 21 types for each of eight element types, which a row calls `T`.
//! One row a type; `docs/from-the-predecessor.md` is made from it. The loader's threads.

use super::Kind::{M, S};
use super::Reads::{Last, Null};
use super::To::{Net, Special};
use super::{Builtin, Row};

#[rustfmt::skip] // A row a type, readable as a table.
pub(super) const ROWS: &[Row] = &[
    Row::new("Value", M, "", "outValue:T", "Value:T")
        .to(Last, Net("{outValue=parent.Value}"))
        .note("becomes a constant where it is read"),
    Row::new("IsNull", M, "inValue*:T", "outValue:bool", "")
        .to(Null, Net("{outValue=IsNull(in=parent.inValue).out}")),
    Row::new("SetNull", M, "inNull*:bool inValue*:T", "outValue:T", "")
        .to(Null, Net("{outValue=NullIf(in=parent.inValue,condition=parent.inNull).out}")).may_be_null(),
    Row::new("AtTime", M, "inAge:double inValue*:T", "outValue:T", "Age:double=0 MaxAge:double=1")
        .to(Null, Net("{outValue=Delay(in=parent.inValue,age=Add(a=parent.inAge,b=CyclePeriod().out).out,max=parent.MaxAge).out}")).may_be_null()
        .note("one cycle more than `Age`, as there; the age is rounded to whole cycles"),
    Row::new("Snapshot", S, "inSnapshot*:bool inValue*:T", "outValue:T", "Value:T")
        .to(Null, Net("{outValue=Hold(in=parent.inValue,sample=parent.inSnapshot,initial=parent.Value).out}"))
        .note("before the first snapshot it is `Value`, as documented there (their core gives 0)"),
    Row::new("Pre", S, "inValue:T", "outValue:T", "")
        .to(Null, Special(Builtin::Pre)).may_be_null()
        .note("null in the first cycle"),
    Row::new("Array", M, "", "outArray:T[]", "Size:int=1")
        .to(Last, Special(Builtin::Array))
        .note("elements are 0 or false where theirs are random"),
    Row::new("ArrayGet", M, "inArray*:T[]", "outValue:T", "Size:int=1 Index:int=0")
        .to(Last, Special(Builtin::ArrayGet))
        .note("`x.out[2]`"),
    Row::new("ArraySet", M, "inArray*:T[] inValue*:T", "outArray:T[]", "Size:int=1 Index:int=0")
        .to(Last, Special(Builtin::ArraySet))
        .note("`[a.out, b.out]`"),
    Row::new("ArrayIsNull", M, "inValue*:T[]", "outValue:bool", "")
        .to(Null, Special(Builtin::ArrayIsNull)),
    Row::new("ArraySetNull", M, "inNull:bool inValue*:T[]", "outValue:T[]", "Size:int=1")
        .to(Null, Special(Builtin::ArraySetNull)).may_be_null(),
    Row::new("ArraySlice", M, "inArray*:T[]", "outArray:T[]", "Size:int=1 Start:int=0")
        .to(Last, Special(Builtin::ArraySlice)),
    Row::new("Conditional", M, "inCondition*:bool inFalse:T inTrue:T", "outValue:T", "True:T False:T")
        .to(Last, Net("{outValue=Select(condition=parent.inCondition,yes=parent.inTrue,no=parent.inFalse).out}")),
    Row::new("NetcommIn", M, "", "outLastUpdated:nsecs outValue:T", "Key:string= Value:T")
        .to(Last, Special(Builtin::NetcommIn))
        .note("its id is `in<Key>`; `outLastUpdated` has no counterpart: read `age`"),
    Row::new("ArrayNetcommIn", M, "", "outLastUpdated:nsecs outValue:T[]", "Key:string= Value:T[]=[]")
        .to(Last, Special(Builtin::NetcommIn))
        .note("as for single values; the length is that of `Value`"),
    Row::new("NetcommOut", M, "inValue:T", "", "Key:string= Report:bool=true Value:T")
        .to(Null, Special(Builtin::NetcommOut))
        .note("its id is `out<Key>`; with `Report` false it is a `Publish` for other nets, with the topic `<net>/out<Key>`"),
    Row::new("ArrayNetcommOut", M, "inValue:T[]", "", "Key:string= Report:bool=true Value:T[]=[]")
        .to(Null, Special(Builtin::NetcommOut))
        .note("its id is `out<Key>`; with `Report` false it is a `Publish` for other nets, with the topic `<net>/out<Key>`"),
    Row::new("InterNetcommIn", M, "", "outLastUpdated:nsecs outValue:T", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Last, Special(Builtin::InterNetcommIn)).may_be_null()
        .note("the topic is `<RemoteNet>/out<RemoteKey>`: what that net gives by a NetcommOut with `Report` false; `outLastUpdated` has no counterpart: read `age`"),
    Row::new("ArrayInterNetcommIn", M, "", "outLastUpdated:nsecs outValue:T[]", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Last, Special(Builtin::InterNetcommIn)).may_be_null()
        .note("the topic is `<RemoteNet>/out<RemoteKey>`: what that net gives by a NetcommOut with `Report` false; `outLastUpdated` has no counterpart: read `age`"),
    Row::new("InterNetcommOut", M, "inValue:T", "", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Null, Special(Builtin::InterNetcommOut))
        .note("the topic is `<RemoteNet>/in<RemoteKey>`; what reads it there is a `Subscribe`: a NetcommIn is set by the application alone"),
    Row::new("ArrayInterNetcommOut", M, "inValue:T[]", "", "RemoteRCC:string= RemoteNet:string= RemoteKey:string=")
        .to(Null, Special(Builtin::InterNetcommOut))
        .note("the topic is `<RemoteNet>/in<RemoteKey>`; what reads it there is a `Subscribe`: a NetcommIn is set by the application alone"),
];
